"""From faces to parts, faces of one material that touch, and which parts move: as the user says, or what only can."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon, box

from femfit.tables.femm.faces import GRID, MIN_AREA, FemFace
from femfit.tables.femm.limits import axial_sign
from femfit.tables.femm.model import FemLabel, FemMaterial
from femfit.tables.femm.notes import Notes
from femfit.tables.femm.options import FemOptions
from femfit.tables.femm.parse import DIGITS

HOW = "Say which blocks move with --moving-group N or --moving-block NAME."


@dataclass(frozen=True)
class FemPart:
    """A connected piece of one material, magnetization (+1 or -1 along z, 0 for none) and group; it may have holes."""

    polygon: Polygon
    material: FemMaterial
    sign: float
    labels: tuple[FemLabel, ...]

    @property
    def group(self) -> int:
        """Group of its blocks."""
        return self.labels[0].group

    @property
    def place(self) -> str:
        """How messages name it."""
        return f"{self.labels[0].place}, group {self.group}"

    @property
    def volume_mm3(self) -> float:
        """Of the body of revolution, 2 pi r A (Pappus)."""
        return float(2.0 * math.pi * self.polygon.centroid.x * self.polygon.area)


def merge_parts(faces: Sequence[FemFace]) -> tuple[FemPart, ...]:
    """Join faces that touch and have material, magnetization and group in common."""
    kinds: dict[tuple[FemMaterial, float, int], list[FemFace]] = {}
    for face in sorted(faces, key=lambda face: face.label.number):
        if face.label.material is not None:
            kinds.setdefault((face.label.material, axial_sign(face.label), face.label.group), []).append(face)
    parts = []
    for (material, sign, _), alike in kinds.items():
        union = shapely.unary_union([face.polygon for face in alike], grid_size=GRID)
        for piece in getattr(union, "geoms", [union]):
            own = [face.label for face in alike if piece.contains(face.polygon.representative_point())]
            parts.append(FemPart(piece, material, sign, tuple(own)))
    return tuple(sorted(parts, key=lambda part: part.labels[0].number))


def simple_outlines(polygon: Polygon) -> list[list[tuple[float, float]]]:
    """Counter-clockwise corners (r, z) in mm of a polygon's pieces, cut along constant z until none has a hole."""
    whole = [polygon]
    simple: list[Polygon] = []
    while whole:
        piece = whole.pop()
        if not piece.interiors:
            simple.append(piece)
            continue
        r0, z0, r1, z1 = piece.bounds
        _, low, _, high = piece.interiors[0].bounds
        cut = round(0.5 * (low + high), DIGITS)
        for half in (box(r0 - 1, z0 - 1, r1 + 1, cut), box(r0 - 1, cut, r1 + 1, z1 + 1)):
            clipped = shapely.intersection(piece, half, grid_size=GRID)
            whole += [part for part in getattr(clipped, "geoms", [clipped]) if part.area >= MIN_AREA]
    return [_corners(piece) for piece in sorted(simple, key=lambda piece: (piece.bounds[1], piece.bounds[0]))]


def _corners(polygon: Polygon) -> list[tuple[float, float]]:
    """The exterior's corners; points on a straight edge are not needed and would refine the mesh there."""
    ring = np.round(np.asarray(shapely.geometry.polygon.orient(polygon).exterior.coords[:-1]), DIGITS) + 0.0
    before, after = np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0)
    chord = after - before
    offset = ring - before
    height = np.abs(chord[:, 0] * offset[:, 1] - chord[:, 1] * offset[:, 0]) / np.hypot(*chord.T)
    return [(float(r), float(z)) for r, z in ring[height > 2 * GRID]]


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
    notes: Notes,
) -> FemBodies | None:
    """Divide the parts into fixed and moving ones; None if nothing moves, or it is not clear what."""
    if not parts:
        notes.problem("no block is magnetic; nothing moves. Give the moving part its steel or magnet.")
        return None
    if options.moving_groups or options.moving_blocks:
        moving = _named(parts, options, notes)
    else:
        moving = _inferred(parts, winding, notes)
    if not moving:
        return None
    spacers = _spacers(moving, air) if len(_connected(moving)) > 1 else ()
    return FemBodies(tuple(part for part in parts if part not in moving), (*moving, *spacers))


def _named(parts: Sequence[FemPart], options: FemOptions, notes: Notes) -> list[FemPart]:
    groups, blocks = set(options.moving_groups), set(options.moving_blocks)
    unknown = [f"group {group}" for group in groups if all(part.group != group for part in parts)]
    unknown += [f"block {name!r}" for name in blocks if all(part.material.name != name for part in parts)]
    if unknown:
        there = "; ".join(part.place for part in parts)
        notes.problem(f"no magnetic part has {' or '.join(sorted(unknown))}; there are {there}.")
        return []
    return [part for part in parts if part.group in groups or part.material.name in blocks]


def _inferred(parts: Sequence[FemPart], winding: Polygon, notes: Notes) -> list[FemPart]:
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
            say = notes.info if len(candidates) == 1 else notes.warn
            say("mover", f"The moving part is {names}: {reason}.", HOW)
            return found[0]
    there = "; ".join(" with ".join(part.place for part in body) for body in bodies)
    notes.problem(f"it is not clear which body moves: {there}. {HOW}")
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
