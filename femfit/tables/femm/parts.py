"""From faces to parts: faces of one material, magnetization and group that touch."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import shapely
from shapely import Polygon

from femfit.tables.femm.faces import GRID, FemFace
from femfit.tables.femm.limits import Direction, magnet_direction
from femfit.tables.femm.model import FemLabel, FemMaterial


@dataclass(frozen=True)
class FemPart:
    """A connected piece of one material, magnetization and group; it may have holes."""

    polygon: Polygon
    material: FemMaterial
    direction: Direction | None
    labels: tuple[FemLabel, ...]

    @property
    def group(self) -> int:
        """Group of its blocks."""
        return self.labels[0].group

    @property
    def place(self) -> str:
        """How messages name it."""
        return f"{self.labels[0].place}, group {self.group}"


def volume_mm3(polygon: Polygon) -> float:
    """Of a body of revolution, 2 pi r A (Pappus)."""
    return float(2.0 * math.pi * polygon.centroid.x * polygon.area)


def merge_parts(faces: Sequence[FemFace]) -> tuple[FemPart, ...]:
    """Join faces that touch and have material, magnetization and group in common."""
    kinds: dict[tuple[FemMaterial, Direction | None, int], list[FemFace]] = {}
    for face in sorted(faces, key=lambda face: face.label.number):
        if face.label.material is not None:
            kinds.setdefault((face.label.material, magnet_direction(face.label), face.label.group), []).append(face)
    parts = []
    for (material, direction, _), alike in kinds.items():
        union = shapely.unary_union([face.polygon for face in alike], grid_size=GRID)
        for piece in getattr(union, "geoms", [union]):
            own = [face.label for face in alike if piece.contains(face.polygon.representative_point())]
            parts.append(FemPart(piece, material, direction, tuple(own)))
    return tuple(sorted(parts, key=lambda part: part.labels[0].number))
