"""From faces to parts: faces of one material that touch become one part, polygons without holes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon, box

from femfit.tables.femm.faces import GRID, MIN_AREA, FemFace
from femfit.tables.femm.limits import axial_sign
from femfit.tables.femm.model import FemLabel, FemMaterial
from femfit.tables.femm.parse import DIGITS


@dataclass(frozen=True)
class FemPart:
    """A connected piece of one material, magnetization and group.

    Parameters
    ----------
    polygon : Polygon
        In the file's coordinates in mm; it may have holes.
    sign : float
        +1 or -1 for a magnet along or against z, 0 otherwise.
    """

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
    """Outlines of a polygon, cut along constant z until no piece has a hole, without needless corners.

    Returns
    -------
    list of list of (float, float)
        Counter-clockwise corners (r, z) in mm of each piece.
    """
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
