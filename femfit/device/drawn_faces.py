"""The faces of a drawing: which numbers of the file move which face, and which faces lie on each other.

A face across the axis or along it is one number. Where slanted edges or arcs adjoin it, a tool that goes deeper moves
them with it, up to the next edges along which they slide: such a contour is one number as well, which stands for its
flat part, and its corners stay numbers of their own.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations
from typing import Any

from femfit.device.complaints import joined, read_part
from femfit.device.drawing import is_winding, part_tables
from femfit.device.file_numbers import Location
from femfit.device.keys import OutlineEntry

COINCIDENT = 1e-6
"""In mm: coordinates that differ by less are one."""


CONTOUR = ".."
"""Between the first and the last corner of a contour in its key, as ``polygon_mm[8..10][1]``."""


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
    part: Location = ()  # The table of the part
    label: str = ""  # What a machinist calls it
    key: str = ""  # Of a contour; that of others is their first location's
    flat: Location = ()  # First location of the face that a contour stands for
    slope: str = ""  # What lies beside that in the contour
    at: tuple[float, float] = (0.0, 0.0)  # A place on it, r and z in mm


@dataclass(frozen=True)
class _Part:
    """A part's table with its outline."""

    path: Location
    body: str
    entry: OutlineEntry
    name: str  # As the file gives it, after "coil" where a region has the same one


def drawn_faces(data: Mapping[str, Any]) -> list[Face]:
    """The faces of all parts, those that touch as one, in the file's order with coils last; none on the axis.

    Contours stand behind them.
    """
    parts = list(_parts(data))
    names = {part.path: part.name for part in parts}
    drawn = [face for part in parts for face in _faces(part)]
    faces = [face for face in drawn if not face.key and (face.axis == 1 or abs(face.value) > COINCIDENT)]
    group = list(range(len(faces)))
    for i, j in combinations(range(len(faces)), 2):
        if _touch(faces[i], faces[j]):
            first, second = sorted((group[i], group[j]))
            group = [first if place == second else place for place in group]
    merged = []
    for place, face in enumerate(faces):
        if group[place] == place:
            members = [face for face, number in zip(faces, group, strict=True) if number == place]
            locations = tuple(chain.from_iterable(member.locations for member in members))
            beside = dict.fromkeys(names[member.part] for member in members if member.part != face.part)
            touching = f" on {' and '.join(beside)}" if beside else ""
            merged.append(replace(face, locations=locations, label=f"{_label(face, parts)}{touching}"))
    contours = [face for face in drawn if face.key]
    for k, face in enumerate(merged):
        over = [contour for contour in contours if contour.flat in face.locations]
        if over:
            merged[k] = replace(face, label=f"{face.label} without {over[0].slope}")
    named = merged + [_completed(face, merged, parts) for face in contours]
    count = Counter(face.label for face in named)
    for k, face in enumerate(named):
        if count[face.label] > 1 and face.span:  # its part has another face at the same coordinate
            low, high = face.span
            named[k] = replace(face, label=f"{face.label} from {'zr'[face.axis]} = {low:g} to {high:g} mm")
    return named


def _completed(contour: Face, merged: Sequence[Face], parts: Sequence[_Part]) -> Face:
    """A contour with what touches its flat faces, and with its label."""
    over = [face for face in merged if face.span is not None and {*face.locations} & {*contour.locations}]
    locations = dict.fromkeys(chain(contour.locations, *(face.locations for face in over)))
    flat = next((face.locations[0] for face in over if contour.flat in face.locations), ())
    label = _label(contour, parts)
    label = f"{label} with {contour.slope}" if contour.flat else label
    return replace(contour, locations=tuple(locations), flat=flat, label=label)


def _label(face: Face, parts: Sequence[_Part]) -> str:
    """What a machinist calls a face."""
    if face.label or face.span is None:
        return face.label
    owner = next(part for part in parts if part.path == face.part)
    axis, words = "rz"[face.axis], "face"
    if face.axis == 0:
        words = "bore" if face.side > 0 else "outer surface"
    return f"{owner.name}: {words} at {axis} = {face.value:g} mm"


def _touch(first: Face, second: Face) -> bool:
    if first.span is None or second.span is None or (first.body, first.axis) != (second.body, second.axis):
        return False
    shared = min(first.span[1], second.span[1]) - max(first.span[0], second.span[0])
    return first.side == -second.side and abs(first.value - second.value) < COINCIDENT and shared > COINCIDENT


def _parts(data: Mapping[str, Any]) -> Iterator[_Part]:
    tables = dict(part_tables(data))
    regions = {place[-1] for place in tables if not is_winding(place)}
    for place, table in tables.items():
        entry = read_part(OutlineEntry, table)
        if entry is not None:
            moves = place[0] == "moving" or (place[0] == "coils" and table.get("moves") is True)
            shared = place[0] == "coils" and place[-1] in regions
            yield _Part(place, "moving" if moves else "fixed", entry, f"{'coil ' * shared}{place[-1]}")


def _faces(part: _Part) -> Iterator[Face]:
    entry, path = part.entry, part.path
    if entry.polygon_mm is not None:
        corners = [(*path, "polygon_mm", k) for k in range(len(entry.polygon_mm))]
        yield from _of_outline(entry.polygon_mm, [((*at, 0), (*at, 1)) for at in corners], part)
    elif entry.circle_mm is not None:
        yield from _of_circle(entry.circle_mm, part)
    elif entry.r_mm is not None and entry.z_mm is not None:
        ends = (0, 1), (0, 0), (1, 0), (1, 1)
        box = [(entry.r_mm[r], entry.z_mm[z]) for r, z in ends]
        yield from _of_outline(box, [((*path, "r_mm", r), (*path, "z_mm", z)) for r, z in ends], part)


def _place(axis: int, value: float, across: float) -> tuple[float, float]:
    return (value, across) if axis == 0 else (across, value)


def _of_circle(circle: Sequence[float], part: _Part) -> Iterator[Face]:
    """Centre and radius; a circle that stands on z = 0, from which distances count, keeps standing there."""
    place, height, radius = circle

    def face(axis: int, value: float, keys: tuple[int, ...], label: str, at: tuple[float, float]) -> Face:
        locations = tuple((*part.path, "circle_mm", key) for key in keys)
        return Face(axis, value, locations, part.body, part=part.path, label=f"{part.name}: {label}", at=at)

    stands = abs(height - radius) < COINCIDENT
    yield face(1, radius, (2, 1) if stands else (2,), f"radius of {radius:g} mm", (place, height + radius))
    if not stands:
        yield face(1, height, (1,), f"centre at z = {height:g} mm", (place, height))
    yield face(0, place, (0,), f"centre at r = {place:g} mm", (place, height))


def _of_outline(
    corners: Sequence[Sequence[float]], stand: Sequence[tuple[Location, Location]], part: _Part
) -> Iterator[Face]:
    """Runs of edges across an axis, the coordinates of all other corners, and contours.

    Each corner's r and z stand at two locations of the file.
    """
    places = [[k] for k in range(len(corners))]
    if list(corners[0]) == list(corners[-1]):
        places[0] += places.pop()
    count = len(places)
    area = sum(
        corners[k][0] * corners[(k + 1) % count][1] - corners[(k + 1) % count][0] * corners[k][1] for k in range(count)
    )
    sense = 1 if area > 0.0 else -1
    joins: tuple[list[bool], list[bool]] = [], []  # whether each edge is straight and lies at one coordinate
    for k, start in enumerate(corners[:count]):
        end, straight = corners[(k + 1) % count], len(start) < 3 or not start[2]
        for axis in (0, 1):
            joins[axis].append(straight and abs(start[axis] - end[axis]) < COINCIDENT)
    for axis in (0, 1):
        across, flat = 1 - axis, []
        for run in _runs(joins[axis]):
            locations = tuple(dict.fromkeys(stand[place][axis] for corner in run for place in places[corner]))
            along, value = [corners[corner][across] for corner in run], corners[run[0]][axis]
            if len(run) == 1:
                r, z = corners[run[0]][:2]
                label = f"{part.name}: corner at r = {r:g} and z = {z:g} mm along {'rz'[axis]}"
                face = Face(axis, value, locations, part.body, part=part.path, label=label, at=(r, z))
            else:
                rising = along[-1] > along[0]
                # The inside lies to the left of an outline that runs counter-clockwise
                side = sense * (1 if rising == (axis == 1) else -1)
                ends = min(along), max(along)
                middle = _place(axis, value, 0.5 * (along[0] + along[-1]))
                face = Face(axis, value, locations, part.body, ends, side, part.path, at=middle)
                flat.append((run, face))
            yield face
        for run in _runs([not is_joined for is_joined in joins[across]]):
            if 1 < len(run) < count and not all(joins[axis][k] for k in run[:-1]):
                yield _contour(corners, places, run, axis, [face for place, face in flat if place[0] in run], part)


def _runs(joins: Sequence[bool]) -> Iterator[list[int]]:
    """Corners that edges join, each to the next one, around an outline."""
    count = len(joins)
    start, run = next((k for k in range(count) if not joins[k - 1]), 0), []
    for step in range(count):
        k = (start + step) % count
        run.append(k)
        if not joins[k] or step == count - 1:
            yield run
            run = []


def _contour(
    corners: Sequence[Sequence[float]],
    places: Sequence[Sequence[int]],
    run: Sequence[int],
    axis: int,
    flat: Sequence[Face],
    part: _Part,
) -> Face:
    """All corners of a run, named by its longest flat face, or by its ends where it has none."""
    path = (*part.path, "polygon_mm")
    locations = tuple((*path, place, axis) for corner in run for place in places[corner])
    key = f"{joined('', *path)}[{run[0]}{CONTOUR}{run[-1]}][{axis}]"
    values, along = [corners[k][axis] for k in run], [corners[k][1 - axis] for k in run]
    curved = any(len(corners[k]) == 3 and corners[k][2] for k in run[:-1])
    if not flat:
        ends = f"{'rz'[axis]} = {values[0]:g} to {values[-1]:g} mm"
        label = f"{part.name}: {'rounded edge' if curved else 'slanted face'} from {ends}"
        middle = _place(axis, 0.5 * (values[0] + values[-1]), 0.5 * (along[0] + along[-1]))
        return Face(axis, values[0], locations, part.body, part=part.path, label=label, key=key, at=middle)
    longest = max(flat, key=lambda face: face.span[1] - face.span[0] if face.span else 0.0)
    return replace(
        longest,
        locations=locations,
        span=(min(along), max(along)),
        key=key,
        flat=longest.locations[0],
        slope="its curve" if curved else "its cone",
    )
