"""The faces of a drawing: which numbers of the file move which face, and which faces lie on each other."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, combinations
from typing import Any

from femfit.device.complaints import read_part
from femfit.device.drawing import fixed_key, table_at
from femfit.device.file_numbers import Location
from femfit.device.schema import OutlineEntry

COINCIDENT = 1e-6
"""In mm: coordinates that differ by less are one."""


@dataclass(frozen=True)
class Face:
    """Numbers of the file that are one coordinate: of a face across an axis, or of a corner or an arc."""

    axis: int  # 0 for r, 1 for z
    value: float  # In mm
    locations: tuple[Location, ...]
    body: str  # ``fixed`` or ``moving``
    # Range in mm along the other axis, and on which side the part lies; of a face alone
    span: tuple[float, float] | None = None
    side: int = 0


def drawn_faces(data: Mapping[str, Any]) -> list[Face]:
    """The faces of all parts, those that touch as one, in the file's order with coils last; none on the axis."""
    faces = [face for face in _faces(data) if face.axis == 1 or abs(face.value) > COINCIDENT]
    group = list(range(len(faces)))
    for one, other in combinations(range(len(faces)), 2):
        if _touch(faces[one], faces[other]):
            first, second = sorted((group[one], group[other]))
            group = [first if place == second else place for place in group]
    merged = []
    for place, face in enumerate(faces):
        if group[place] == place:
            locations = [one.locations for one, own in zip(faces, group, strict=True) if own == place]
            merged.append(Face(face.axis, face.value, tuple(chain.from_iterable(locations)), face.body))
    return merged


def _touch(one: Face, other: Face) -> bool:
    if one.span is None or other.span is None or (one.body, one.axis) != (other.body, other.axis):
        return False
    shared = min(one.span[1], other.span[1]) - max(one.span[0], other.span[0])
    return one.side == -other.side and abs(one.value - other.value) < COINCIDENT and shared > COINCIDENT


def _faces(data: Mapping[str, Any]) -> Iterator[Face]:
    parts: list[tuple[Location, str, Any]] = []
    for key, body in ((fixed_key(data), "fixed"), ("moving", "moving")):
        parts += [((key, "regions", name), body, table) for name, table in table_at(data, key, "regions").items()]
    if isinstance(data.get("coil"), dict):
        parts.append((("coil",), "fixed", data["coil"]))
    for name, table in table_at(data, "coils").items():
        parts.append((("coils", name), "moving" if table.get("moves") is True else "fixed", table))
    for path, body, table in parts:
        entry = read_part(OutlineEntry, table)
        if entry is None:
            continue
        if entry.polygon_mm is not None:
            yield from _of_polygon(entry.polygon_mm, (*path, "polygon_mm"), body)
        elif entry.circle_mm is not None:
            yield from _of_circle(entry.circle_mm, (*path, "circle_mm"), body)
        elif entry.r_mm is not None and entry.z_mm is not None:
            for axis, key, own, across in ((0, "r_mm", entry.r_mm, entry.z_mm), (1, "z_mm", entry.z_mm, entry.r_mm)):
                for end, side in ((0, 1), (1, -1)):
                    yield Face(axis, own[end], ((*path, key, end),), body, (across[0], across[1]), side)


def _of_circle(circle: Sequence[float], path: Location, body: str) -> Iterator[Face]:
    """Centre and radius; a circle that stands on z = 0, from which distances count, keeps standing there."""
    _, height, radius = circle
    if abs(height - radius) < COINCIDENT:
        yield Face(1, radius, ((*path, 2), (*path, 1)), body)
    else:
        yield Face(1, radius, ((*path, 2),), body)
        yield Face(1, height, ((*path, 1),), body)
    yield Face(0, circle[0], ((*path, 0),), body)


def _of_polygon(corners: Sequence[Sequence[float]], path: Location, body: str) -> Iterator[Face]:
    """Runs of edges across an axis, and the coordinates of all other corners."""
    places = [[k] for k in range(len(corners))]
    if list(corners[0]) == list(corners[-1]):
        places[0] += places.pop()
    count = len(places)
    area = sum(
        corners[k][0] * corners[(k + 1) % count][1] - corners[(k + 1) % count][0] * corners[k][1] for k in range(count)
    )
    sense = 1 if area > 0.0 else -1
    for axis in (0, 1):
        across = 1 - axis
        joins = [
            abs(corners[k][axis] - corners[(k + 1) % count][axis]) < COINCIDENT
            and not (len(corners[k]) == 3 and corners[k][2])
            for k in range(count)
        ]
        start = next((k for k in range(count) if not joins[k - 1]), 0)
        run: list[int] = []
        for step in range(count):
            k = (start + step) % count
            run.append(k)
            if joins[k] and step < count - 1:
                continue
            locations = tuple((*path, place, axis) for one in run for place in places[one])
            along = [corners[one][across] for one in run]
            if len(run) == 1:
                yield Face(axis, corners[k][axis], locations, body)
            else:
                rising = along[-1] > along[0]
                # The inside lies to the left of an outline that runs counter-clockwise
                side = sense * (1 if rising == (axis == 1) else -1)
                yield Face(axis, corners[k][axis], locations, body, (min(along), max(along)), side)
            run = []
