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

    part: PartTable
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

    def touches(self, other: "Face") -> bool:
        """Whether two faces lie on each other."""
        if self.span is None or other.span is None or (self.part.moves, self.axis) != (other.part.moves, other.axis):
            return False
        shared = min(self.span[1], other.span[1]) - max(self.span[0], other.span[0])
        return self.side == -other.side and abs(self.value - other.value) < COINCIDENT and shared > COINCIDENT


def drawn_faces(data: Mapping[str, Any]) -> list[Face]:
    """The faces of all parts, those that touch as one, in the file's order with coils last; none on the axis.

    Contours stand behind them.
    """
    drawn = [face for part in part_tables(data) for face in _faces(part)]
    faces = [face for face in drawn if not face.key and (face.axis == 1 or abs(face.value) > COINCIDENT)]
    contours = [face for face in drawn if face.key]
    touching = np.array([[face.touches(other) for other in faces] for face in faces], dtype=bool)
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
    beside = dict.fromkeys(member.part.label for member in members if member.part is not face.part)
    label = f"{face.label} on {' and '.join(beside)}" if beside else face.label
    slopes = [contour.slope for contour in contours if contour.flat in locations]
    return replace(face, locations=locations, label=f"{label} without {slopes[0]}" if slopes else label)


def _completed(contour: Face, merged: Sequence[Face]) -> Face:
    """A contour with what touches its flat faces."""
    over = [face for face in merged if face.span is not None and {*face.locations} & {*contour.locations}]
    locations = dict.fromkeys(chain(contour.locations, *(face.locations for face in over)))
    flat = next((face.locations[0] for face in over if contour.flat in face.locations), ())
    return replace(contour, locations=tuple(locations), flat=flat)


def _faces(part: PartTable) -> Iterator[Face]:
    shape, path = part.shape, part.place
    if shape is None:
        return
    if shape.polygon_mm is not None:
        corners = list(shape.polygon_mm)
        places: list[Place] = [(*path, "polygon_mm", k) for k in range(len(corners))]
        stand: list[list[tuple[Place, ...]]] = [[((*place, axis),) for axis in (0, 1)] for place in places]
        if corners[0] == corners[-1]:
            corners.pop()
            stand[0] = [first + last for first, last in zip(stand[0], stand.pop(), strict=True)]
        yield from _Outline(part, corners, stand).faces()
    elif shape.circle_mm is not None:
        yield from _of_circle(shape.circle_mm, part)
    elif shape.r_mm is not None and shape.z_mm is not None:
        ends = (0, 1), (0, 0), (1, 0), (1, 1)
        stand = [[((*path, "r_mm", r),), ((*path, "z_mm", z),)] for r, z in ends]
        yield from _Outline(part, [(shape.r_mm[r], shape.z_mm[z]) for r, z in ends], stand).faces()


def _of_circle(circle: Sequence[float], part: PartTable) -> Iterator[Face]:
    """Centre and radius; a circle that stands on z = 0, from which distances count, keeps standing there."""
    r, z, radius = circle
    stands = abs(z - radius) < COINCIDENT
    lengths: list[tuple[int, float, list[int], str, float]] = [
        (1, radius, [2, 1] if stands else [2], "radius of", z + radius),
        *([] if stands else [(1, z, [1], "centre at z =", z)]),
        (0, r, [0], "centre at r =", z),
    ]
    for axis, value, keys, words, height in lengths:
        locations: tuple[Place, ...] = tuple((*part.place, "circle_mm", key) for key in keys)
        yield Face(part, axis, value, locations, f"{part.label}: {words} {value:g} mm", (r, height))


@dataclass(frozen=True)
class _Outline:
    """Corners of a part (r, z, and the angle of an arc to the next), whose r and z each stand at places of the file."""

    part: PartTable
    corners: Sequence[Sequence[float]]
    stand: Sequence[Sequence[tuple[Place, ...]]]

    def faces(self) -> Iterator[Face]:
        """Runs of edges across an axis, the coordinates of all other corners, and contours."""
        corners, count = self.corners, len(self.corners)
        edges = list(zip(range(count), corners, [*corners[1:], corners[0]], strict=True))
        area = sum(start[0] * end[1] - end[0] * start[1] for _, start, end in edges)
        # Whether each edge is straight and lies at one coordinate
        joins = [
            [not self.is_arc(k) and abs(start[axis] - end[axis]) < COINCIDENT for k, start, end in edges]
            for axis in (0, 1)
        ]
        for axis in (0, 1):
            flat = []
            for run in _runs(joins[axis]):
                value, along = corners[run[0]][axis], [corners[corner][1 - axis] for corner in run]
                if len(run) == 1:
                    r, z = corners[run[0]][:2]
                    label = f"{self.part.label}: corner at r = {r:g} and z = {z:g} mm along {'rz'[axis]}"
                    yield Face(self.part, axis, value, self.locations(run, axis), label, (r, z))
                    continue
                # The inside lies to the left of an outline that runs counter-clockwise
                side = (1 if area > 0.0 else -1) * (1 if (along[-1] > along[0]) == (axis == 1) else -1)
                words = "face" if axis else "bore" if side > 0 else "outer surface"
                label = f"{self.part.label}: {words} at {'rz'[axis]} = {value:g} mm"
                span, at = (min(along), max(along)), _place(axis, value, 0.5 * (along[0] + along[-1]))
                face = Face(self.part, axis, value, self.locations(run, axis), label, at, span, side)
                flat.append((run, face))
                yield face
            for run in _runs([not is_joined for is_joined in joins[1 - axis]]):
                if 1 < len(run) < count and not all(joins[axis][k] for k in run[:-1]):
                    yield self.contour(run, axis, [face for place, face in flat if place[0] in run])

    def is_arc(self, corner: int) -> bool:
        """Whether the edge from a corner is one."""
        return len(self.corners[corner]) == 3 and bool(self.corners[corner][2])

    def locations(self, run: Sequence[int], axis: int) -> tuple[Place, ...]:
        """Places of a run's coordinates in the file."""
        return tuple(dict.fromkeys(place for corner in run for place in self.stand[corner][axis]))

    def contour(self, run: Sequence[int], axis: int, flat: Sequence[Face]) -> Face:
        """All corners of a run, named by its longest flat face, or by its ends where it has none."""
        key = f"{joined('', *self.part.place, 'polygon_mm')}[{run[0]}{CONTOUR}{run[-1]}][{axis}]"
        values, along = ([self.corners[k][across] for k in run] for across in (axis, 1 - axis))
        curved, locations = any(map(self.is_arc, run[:-1])), self.locations(run, axis)
        if not flat:
            ends = f"{'rz'[axis]} = {values[0]:g} to {values[-1]:g} mm"
            label = f"{self.part.label}: {'rounded edge' if curved else 'slanted face'} from {ends}"
            middle = _place(axis, 0.5 * (values[0] + values[-1]), 0.5 * (along[0] + along[-1]))
            return Face(self.part, axis, values[0], locations, label, middle, key=key)
        longest = max(flat, key=lambda face: face.span[1] - face.span[0] if face.span else 0.0)
        span, slope = (min(along), max(along)), "its curve" if curved else "its cone"
        label, first = f"{longest.label} with {slope}", longest.locations[0]
        return replace(longest, locations=locations, span=span, key=key, flat=first, slope=slope, label=label)


def _place(axis: int, value: float, across: float) -> tuple[float, float]:
    return (across, value) if axis else (value, across)


def _runs(joins: Sequence[bool]) -> Iterator[list[int]]:
    """Corners that edges join, each to the next one, around an outline."""
    count = len(joins)
    start = next((k for k in range(count) if not joins[k - 1]), 0)
    order = [(start + step) % count for step in range(count)]
    breaks = [0, *(step + 1 for step, k in enumerate(order[:-1]) if not joins[k]), count]
    yield from (order[first:last] for first, last in pairwise(breaks))
