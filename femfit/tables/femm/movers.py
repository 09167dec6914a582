"""Which parts and windings move: as the user says, or what only can."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import shapely

from femfit.tables.femm.faces import GRID, FemPiece
from femfit.tables.femm.model import FemOptions, Notes
from femfit.tables.femm.parts import volume_mm3

Body = Sequence[FemPiece]


@dataclass(frozen=True)
class FemBodies:
    """Parts and windings, divided."""

    fixed: tuple[FemPiece, ...]
    moving: tuple[FemPiece, ...]


def outline_of(body: Body) -> shapely.Geometry:
    """A body's pieces together, in the file's coordinates."""
    return shapely.union_all([piece.polygon for piece in body])


def divide(pieces: Body, air: Body, options: FemOptions, notes: Notes) -> FemBodies | None:
    """Divide parts and windings into fixed and moving ones; None if nothing moves, or it is not clear what."""
    bodies = _connected(pieces)
    faults = {
        "mover nothing": not pieces,
        "mover field": not _wound(pieces) and not _magnet(pieces),
        "mover alone": len(pieces) == 1,
        "mover touching": len(bodies) == 1,
    }
    for fault in [name for name, wrong in faults.items() if wrong][:1]:
        notes.say(fault, places=" and ".join(piece.place for piece in pieces))
        return None
    moving = _named(bodies, options.moving_labels, notes) if options.moving_labels else _inferred(bodies, notes)
    if not moving:
        return None
    # Non-magnetic blocks of its group join what moves, where that is in pieces
    groups = {piece.group for piece in moving if piece.group} if len(_connected(moving)) > 1 else set()
    joining = [face for face in air if face.label.meshed and face.group in groups]
    fixed = tuple(piece for piece in pieces if piece not in moving)
    return FemBodies(fixed, (*(piece for piece in pieces if piece in moving), *joining))


def _named(bodies: Sequence[Body], labels: Sequence[int], notes: Notes) -> Body:
    numbers = [[label.number for piece in body for label in piece.labels] for body in bodies]
    unknown = [str(number) for number in labels if not any(number in of_body for of_body in numbers)]
    if unknown:
        notes.say("mover unknown", names=" or ".join(unknown), candidates=_candidates(bodies))
        return []
    chosen = [body for body, of_body in zip(bodies, numbers, strict=True) if set(labels) & set(of_body)]
    if len(chosen) == len(bodies):
        notes.say("mover everything", candidates=_candidates(bodies))
        return []
    return [piece for body in chosen for piece in body]


def _inferred(bodies: Sequence[Body], notes: Notes) -> Body:
    """The body that alone can be the moving one; of two, the one that is usually moved."""
    candidates = [body for body in bodies if not _wound(body)]
    grouped = [body for body in bodies if any(piece.group for piece in body)]
    rules: tuple[tuple[Callable[[Body], bool], str], ...] = (
        (lambda body: grouped == [body] and all(piece.group for piece in body), "the only body with a group above 0"),
        (_magnet, "the only body with a magnet"),
        (lambda body: _clear(body, bodies), "the only body clear above or below the windings"),
        (lambda body: any(piece.polygon.bounds[0] <= GRID for piece in body), "the only body on the axis"),
        (lambda _: True, "the only body that does not touch a winding"),
    )
    if len(bodies) == 2:
        moving, reason = _of_two(bodies)
        _say(moving, reason, bodies, notes)
        return moving
    for rule, reason in rules:
        if len(matching := [body for body in candidates if rule(body)]) == 1:
            _say(matching[0], reason, bodies, notes)
            return matching[0]
    notes.say("mover unclear", candidates=_candidates(bodies))
    return []


def _of_two(bodies: Sequence[Body]) -> tuple[Body, str]:
    """One of two bodies: only their motion against each other counts, and the other one may be named instead."""
    wound = [body for body in bodies if _wound(body)]
    bare = [body for body in bodies if not _wound(body)]
    if len(bare) == 1 and len(wound) == 1:
        alone = all(piece.turns for piece in wound[0])
        iron = any(piece.material.curve or not _magnet([piece]) for piece in bare[0])
        if alone and _magnet(bare[0]) and iron:
            return wound[0], "a winding before a magnet with its iron, as in a voice coil"
        return bare[0], "the only body that does not touch a winding"
    smaller = min(bodies, key=lambda body: sum(volume_mm3(piece.polygon) for piece in body))
    return smaller, "the smaller one of two bodies"


def _say(moving: Body, reason: str, bodies: Sequence[Body], notes: Notes) -> None:
    """Say what moves; a warning where another body could move as well."""
    alternatives = [body for body in bodies if body is not moving]
    names = " and ".join(piece.place for piece in moving)
    key = "mover chosen" if any(not _wound(body) or _wound(moving) for body in alternatives) else "mover"
    options = " or ".join(map(option_for, alternatives))
    notes.say(key, names=names, reason=reason, options=options)


def option_for(body: Body) -> str:
    """The option that names a body and no other."""
    return f"--moving-label {min(label.number for piece in body for label in piece.labels)}"


def _candidates(bodies: Sequence[Body]) -> str:
    return "".join(f"\n    {option_for(body)} for {' with '.join(piece.place for piece in body)}" for body in bodies)


def _wound(body: Body) -> bool:
    return any(piece.turns for piece in body)


def _magnet(body: Body) -> bool:
    return any(piece.direction is not None for piece in body)


def _clear(body: Body, bodies: Sequence[Body]) -> bool:
    """Whether a body stands above or below all windings."""
    wound = [piece.polygon.bounds for rival in bodies for piece in rival if piece.turns]
    low = min((bounds[1] for bounds in wound), default=math.inf)
    high = max((bounds[3] for bounds in wound), default=-math.inf)
    if not wound:
        return False
    _, bottom, _, top = outline_of(body).bounds
    return bool(bottom >= high or top <= low)


def _connected(pieces: Body) -> list[Body]:
    """Pieces that touch each other, together."""
    bodies: list[Body] = []
    for piece in pieces:
        joined = [
            body for body in bodies if any(piece.polygon.distance(neighbour.polygon) <= GRID for neighbour in body)
        ]
        bodies = [body for body in bodies if body not in joined]
        bodies.append([*(neighbour for body in joined for neighbour in body), piece])
    return bodies
