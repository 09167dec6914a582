"""From faces to parts: faces of one material, magnetization and group that touch."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from shapely import Polygon

from femfit.tables.femm.faces import FemFace, FemPiece, connected_faces
from femfit.tables.femm.limits import Direction, magnet_direction
from femfit.tables.femm.model import FemMaterial


@dataclass(frozen=True)
class FemPart(FemPiece):
    """A connected piece of one material, magnetization and group; it may have holes."""

    direction: Direction | None


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
        for polygon, joined in connected_faces(alike):
            parts.append(FemPart(polygon, material, tuple(face.label for face in joined), direction))
    return tuple(sorted(parts, key=lambda part: part.labels[0].number))
