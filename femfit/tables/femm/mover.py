"""Which parts of a FEMM model move: as the user says, or the one body that can only be it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import shapely
from shapely import Polygon

from femfit.core.finding import Finding, Severity
from femfit.tables.femm.faces import GRID, FemFace
from femfit.tables.femm.options import FemOptions
from femfit.tables.femm.parts import FemPart

HOW = "Say which blocks move with --moving-group N or --moving-block NAME."


@dataclass(frozen=True)
class FemBodies:
    """The parts, divided."""

    fixed: tuple[FemPart, ...]
    moving: tuple[FemPart, ...]


def divide(
    parts: Sequence[FemPart],
    air: Sequence[FemFace],
    winding: Polygon,
    options: FemOptions,
    problems: list[str],
    findings: list[Finding],
) -> FemBodies | None:
    """Divide the parts into fixed and moving ones.

    Returns
    -------
    FemBodies or None
        None if nothing moves, or it is not clear what.
    """
    if not parts:
        problems.append("no block is magnetic; nothing moves. Give the moving part its steel or magnet.")
        return None
    if options.moving_groups or options.moving_blocks:
        moving = _named(parts, options, problems)
    else:
        moving = _inferred(parts, winding, problems, findings)
    if not moving:
        return None
    spacers = _spacers(moving, air) if len(_connected(moving)) > 1 else ()
    return FemBodies(tuple(part for part in parts if part not in moving), (*moving, *spacers))


def _named(parts: Sequence[FemPart], options: FemOptions, problems: list[str]) -> list[FemPart]:
    groups, blocks = set(options.moving_groups), set(options.moving_blocks)
    unknown = [f"group {group}" for group in groups if all(part.group != group for part in parts)]
    unknown += [f"block {name!r}" for name in blocks if all(part.material.name != name for part in parts)]
    if unknown:
        there = "; ".join(part.place for part in parts)
        problems.append(f"no magnetic part has {' or '.join(sorted(unknown))}; there are {there}.")
        return []
    return [part for part in parts if part.group in groups or part.material.name in blocks]


def _inferred(
    parts: Sequence[FemPart], winding: Polygon, problems: list[str], findings: list[Finding]
) -> list[FemPart]:
    """One body that alone is a magnet, or alone stands clear above or below the winding, or is alone at all."""
    bodies = _connected(parts)
    _, low, _, high = winding.bounds

    def magnet(body: Sequence[FemPart]) -> bool:
        return any(part.sign for part in body)

    def clear(body: Sequence[FemPart]) -> bool:
        _, bottom, _, top = shapely.union_all([part.polygon for part in body]).bounds
        return bool(bottom >= high or top <= low)

    def apart(body: Sequence[FemPart]) -> bool:
        return all(part.polygon.distance(winding) > GRID for part in body)

    rules: tuple[tuple[Callable[[Sequence[FemPart]], bool], str], ...] = (
        (magnet, "the only body with a magnet"),
        (clear, "the only body clear above or below the winding"),
        (apart, "the only body that does not touch the winding"),
    )
    candidates = [body for body in bodies if apart(body)]
    for rule, reason in rules:
        found = [body for body in candidates if rule(body)]
        if len(found) == 1:
            names = " and ".join(part.place for part in found[0])
            severity: Severity = "info" if len(candidates) == 1 else "warning"
            findings.append(Finding("mover", severity, f"The moving part is {names}: {reason}.", HOW))
            return found[0]
    there = "; ".join(" with ".join(part.place for part in body) for body in bodies)
    problems.append(f"it is not clear which body moves: {there}. {HOW}")
    return []


def _connected(parts: Sequence[FemPart]) -> list[list[FemPart]]:
    """Parts that touch each other, together."""
    bodies: list[list[FemPart]] = []
    for part in parts:
        joined = [body for body in bodies if any(part.polygon.distance(other.polygon) <= GRID for other in body)]
        bodies = [body for body in bodies if body not in joined]
        bodies.append([*(other for body in joined for other in body), part])
    return bodies


def _spacers(moving: Sequence[FemPart], air: Sequence[FemFace]) -> tuple[FemPart, ...]:
    """Non-magnetic blocks of the moving groups that touch the body; without them it would be in pieces."""
    groups = {part.group for part in moving if part.group}
    return tuple(
        FemPart(face.polygon, face.label.material, 0.0, (face.label,))
        for face in air
        if face.label.material is not None and face.label.group in groups
    )
