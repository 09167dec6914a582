"""The faces of a drawing: which numbers of the file move which face, and which faces lie on each other.

A face across the axis or along it is one number. Where slanted edges or arcs adjoin it, a tool that goes deeper moves
them with it, up to the next edges along which they slide: such a contour is one number as well, which stands for its
flat part, and its corners stay numbers of their own.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise
from typing import Any

import numpy as np
from scipy.sparse.csgraph import connected_components

from femfit.device.complaints import joined
from femfit.device.drawing import PartTable, part_tables
from femfit.device.keys import Place

COINCIDENT = 1e-6
"""In mm: coordinates that differ by less are one."""


CONTOUR = ".."
"""Between the first and the last corner of a contour in its key, as ``polygon_mm[8..10][1]``."""


@dataclass(frozen=True)
class Face:
    """Numbers of the file that are one coordinate: of a face across an axis, or of a corner or an arc."""

    table: PartTable  # Of the region or winding
    axis: int  # 0 for r, 1 for z
    value: float  # In mm
    locations: tuple[Place, ...]
    label: str  # What a machinist calls it
    at: tuple[float, float]  # A place on it, r and z in mm
    # Range in mm along the other axis, and on which side the part lies; of a face alone
    span: tuple[float, float] | None = None
    side: int = 0
    key: str = ""  # Of a contour; that of others is their first location's
    flat: Place = ()  # First location of the face that a contour stands for
    slope: str = ""  # What lies beside that in the contour

    def touches(self, face: "Face") -> bool:
        """Whether two faces lie on each other."""
        if self.span is None or face.span is None or (self.table.moves, self.axis) != (face.table.moves, face.axis):
            return False
        shared = min(self.span[1], face.span[1]) - max(self.span[0], face.span[0])
        return self.side == -face.side and abs(self.value - face.value) < COINCIDENT and shared > COINCIDENT


def drawn_faces(data: Mapping[str, Any]) -> list[Face]:
    """The faces of all parts, those that touch as one, in the file's order with coils last; none on the axis.

    Contours stand behind them.
    """
    drawn = [face for table in part_tables(data) for face in _faces(table)]
    faces = [face for face in drawn if not face.key and (face.axis == 1 or abs(face.value) > COINCIDENT)]
    contours = [face for face in drawn if face.key]
    touching = np.array([[face.touches(beside) for beside in faces] for face in faces], dtype=bool)
    count, group = connected_components(touching.reshape(len(faces), len(faces)), directed=False)
    merged = [_merged([face for face, k in zip(faces, group, strict=True) if k == n], contours) for n in range(count)]
    named = merged + [_completed(contour, merged) for contour in contours]
    shared = Counter(face.label for face in named)
    for k, face in enumerate(named):
        if shared[face.label] > 1 and face.span:  # its part has another face at the same coordinate
            low, high = face.span
            named[k] = replace(face, label=f"{face.label} from {'zr'[face.axis]} = {low:g} to {high:g} mm")
    return named


def _merged(members: Sequence[Face], contours: Sequence[Face]) -> Face:
    """Faces that touch as one, the first of them, which says what it lies on and that its contour is another."""
    face = members[0]
    locations = tuple(chain.from_iterable(member.locations for member in members))
    beside = dict.fromkeys(member.table.label for member in members if member.table is not face.table)
    label = f"{face.label} on {' and '.join(beside)}" if beside else face.label
    slopes = [contour.slope for contour in contours if contour.flat in locations]
    return replace(face, locations=locations, label=f"{label} without {slopes[0]}" if slopes else label)


def _completed(contour: Face, merged: Sequence[Face]) -> Face:
    """A contour with what touches its flat faces."""
    over = [face for face in merged if face.span is not None and {*face.locations} & {*contour.locations}]
    locations = dict.fromkeys(chain(contour.locations, *(face.locations for face in over)))
    flat = next((face.locations[0] for face in over if contour.flat in face.locations), ())
    return replace(contour, locations=tuple(locations), flat=flat)


def _faces(table: PartTable) -> Iterator[Face]:
    shape, path = table.shape, table.place
    if shape is None:
        return
    if shape.polygon_mm is not None:
        corners = list(shape.polygon_mm)
        places: list[list[tuple[Place, ...]]] = [
            [((*path, "polygon_mm", k, axis),) for axis in (0, 1)] for k in range(len(corners))
        ]
        if corners[0] == corners[-1]:
            corners.pop()
            places[0] = [first + last for first, last in zip(places[0], places.pop(), strict=True)]
        yield from _of_corners(table, corners, places)
    elif shape.circle_mm is not None:
        yield from _of_circle(table, shape.circle_mm)
    elif shape.r_mm is not None and shape.z_mm is not None:
        ends = (0, 1), (0, 0), (1, 0), (1, 1)
        places = [[((*path, "r_mm", r),), ((*path, "z_mm", z),)] for r, z in ends]
        yield from _of_corners(table, [(shape.r_mm[r], shape.z_mm[z]) for r, z in ends], places)


def _of_circle(table: PartTable, circle: Sequence[float]) -> Iterator[Face]:
    """Centre and radius; a circle that stands on z = 0, from which distances count, keeps standing there."""
    r, z, radius = circle
    stands = abs(z - radius) < COINCIDENT
    lengths: list[tuple[int, float, list[int], str, float]] = [
        (1, radius, [2, 1] if stands else [2], "radius of", z + radius),
        *([] if stands else [(1, z, [1], "centre at z =", z)]),
        (0, r, [0], "centre at r =", z),
    ]
    for axis, value, keys, words, height in lengths:
        locations: tuple[Place, ...] = tuple((*table.place, "circle_mm", key) for key in keys)
        yield Face(table, axis, value, locations, f"{table.label}: {words} {value:g} mm", (r, height))


def _of_corners(
    table: PartTable, corners: Sequence[Sequence[float]], places: Sequence[Sequence[tuple[Place, ...]]]
) -> Iterator[Face]:
    """Runs of edges across an axis, the coordinates of all other corners, and contours.

    Corners are (r, z, and the angle of an arc to the next); the r and z of each stand at places of the file.
    """
    edges = [*zip(corners, [*corners[1:], corners[0]], strict=True)]
    turns_left = sum(start[0] * end[1] - end[0] * start[1] for start, end in edges) > 0.0
    arcs = [any(corner[2:]) for corner in corners]
    # Whether each edge is straight and lies at one coordinate
    joins = [
        [not arc and abs(start[axis] - end[axis]) < COINCIDENT for arc, (start, end) in zip(arcs, edges, strict=True)]
        for axis in (0, 1)
    ]
    for axis in (0, 1):
        flat: list[Face] = []
        for run in _runs(joins[axis]):
            value, along = corners[run[0]][axis], [corners[corner][1 - axis] for corner in run]
            locations = _locations(places, run, axis)
            if len(run) == 1:
                r, z = corners[run[0]][:2]
                label = f"{table.label}: corner at r = {r:g} and z = {z:g} mm along {'rz'[axis]}"
                yield Face(table, axis, value, locations, label, (r, z))
                continue
            # The inside lies to the left of an outline that runs counter-clockwise
            side = 1 if turns_left == ((along[-1] > along[0]) == (axis == 1)) else -1
            words = "face" if axis else "bore" if side > 0 else "outer surface"
            label, span = f"{table.label}: {words} at {'rz'[axis]} = {value:g} mm", (min(along), max(along))
            middle = _place(axis, value, 0.5 * (along[0] + along[-1]))
            flat.append(Face(table, axis, value, locations, label, middle, span, side))
            yield flat[-1]
        for run in _runs([not is_joined for is_joined in joins[1 - axis]]):
            if 1 < len(run) < len(corners) and not all(joins[axis][k] for k in run[:-1]):
                locations = _locations(places, run, axis)
                within = [face for face in flat if face.locations[0] in locations]
                values, along = ([corners[k][across] for k in run] for across in (axis, 1 - axis))
                curved = any(arcs[k] for k in run[:-1])
                key = f"{joined('', *table.place, 'polygon_mm')}[{run[0]}{CONTOUR}{run[-1]}][{axis}]"
                if within:
                    longest = max(within, key=lambda face: face.span[1] - face.span[0] if face.span else 0.0)
                    slope = "its curve" if curved else "its cone"
                    named = replace(longest, label=f"{longest.label} with {slope}", key=key, slope=slope)
                    span = min(along), max(along)
                    yield replace(named, locations=locations, span=span, flat=longest.locations[0])
                    continue
                ends = f"{'rz'[axis]} = {values[0]:g} to {values[-1]:g} mm"
                label = f"{table.label}: {'rounded edge' if curved else 'slanted face'} from {ends}"
                middle = _place(axis, 0.5 * (values[0] + values[-1]), 0.5 * (along[0] + along[-1]))
                yield Face(table, axis, values[0], locations, label, middle, key=key)


def _locations(places: Sequence[Sequence[tuple[Place, ...]]], run: Sequence[int], axis: int) -> tuple[Place, ...]:
    """Places of a run's coordinates in the file."""
    return tuple(dict.fromkeys(place for corner in run for place in places[corner][axis]))


def _place(axis: int, value: float, across: float) -> tuple[float, float]:
    return (across, value) if axis else (value, across)


def _runs(joins: Sequence[bool]) -> Iterator[list[int]]:
    """Corners that edges join, each to the next one, around an outline."""
    count = len(joins)
    start = next((k for k in range(count) if not joins[k - 1]), 0)
    order = [(start + step) % count for step in range(count)]
    breaks = [0, *(step + 1 for step, k in enumerate(order[:-1]) if not joins[k]), count]
    yield from (order[first:last] for first, last in pairwise(breaks))
