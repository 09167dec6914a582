"""The winding of a FEMM model: the blocks of one circuit, as one region of uniform current density."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import shapely
from shapely import Polygon

from femfit.core.finding import Finding
from femfit.tables.femm.faces import GRID, FemFace
from femfit.tables.femm.model import FemCircuit, FemMaterial

DENSITY_TOLERANCE = 1e-3
"""Relative difference of the turns per area of two blocks that still counts as one winding."""

PLAIN_WIRE = 3
"""``LamType`` of round magnet wire; it and above are wound, below are solid."""


@dataclass(frozen=True)
class FemWinding:
    """A winding.

    Parameters
    ----------
    polygon : Polygon
        Its section in the file's coordinates in mm.
    """

    polygon: Polygon
    turns: float
    circuit: FemCircuit
    material: FemMaterial
    names: tuple[str, ...]

    @property
    def round_wire(self) -> bool:
        """Whether it is wound from single round wires of known diameter."""
        return self.material.lamination_type == PLAIN_WIRE and self.material.wire_diameter_mm > 0.0

    @property
    def wire_resistance_ohm(self) -> float | None:
        """R = N 2 pi r / (sigma s pi d^2 / 4) of wire with s strands; None where the file does not say the wire."""
        material = self.material
        if material.lamination_type < PLAIN_WIRE or not material.wire_diameter_mm or not material.conductivity:
            return None
        section = max(material.strands, 1) * math.pi * (material.wire_diameter_mm * 1e-3) ** 2 / 4.0
        length = abs(self.turns) * 2.0 * math.pi * self.polygon.centroid.x * 1e-3
        return float(length / (material.conductivity * 1e6 * section))


def find_winding(
    faces: Sequence[FemFace], name: str | None, problems: list[str], findings: list[Finding]
) -> FemWinding | None:
    """The winding among the faces.

    Returns
    -------
    FemWinding or None
        None if there is none that can be taken.
    """
    circuit = _chosen(faces, name, problems, findings)
    if circuit is None:
        return None
    blocks = [face for face in faces if face.label.circuit == circuit]
    before = len(problems)
    if not circuit.series:
        problems.append(
            f"circuit {circuit.name!r} is parallel (solid conductors); femfit's winding has uniform current density. "
            "Make it series and give its block the number of turns."
        )
    for block in blocks:
        material = block.label.material
        if material is not None and material.magnetic:
            problems.append(f"{block.label.place} is magnetic and in circuit {circuit.name!r}. Wind it with copper.")
        if block.label.turns == 0:
            problems.append(f"{block.label.place} has no turns in circuit {circuit.name!r}. Give their number.")
    if len(problems) > before:
        return None
    return _joined(blocks, circuit, problems, findings)


def _chosen(
    faces: Sequence[FemFace], name: str | None, problems: list[str], findings: list[Finding]
) -> FemCircuit | None:
    circuits = list(dict.fromkeys(face.label.circuit for face in faces if face.label.circuit is not None))
    if not circuits:
        problems.append("no block belongs to a circuit; femfit needs a winding. Assign a series circuit and turns.")
        return None
    listed = ", ".join(f"{circuit.name!r} ({circuit.current_A:g} A)" for circuit in circuits)
    chosen = [circuit for circuit in circuits if circuit.name == name] if name else circuits
    if not name and len(circuits) > 1:
        chosen = [circuit for circuit in circuits if circuit.current_A] or circuits
    if len(chosen) != 1:
        what = f"no circuit is named {name!r}" if name and not chosen else "several circuits could be the winding"
        problems.append(f"{what}: {listed}. Name one with --circuit; the others must carry 0 A.")
        return None
    others = [circuit for circuit in circuits if circuit != chosen[0]]
    if any(circuit.current_A for circuit in others):
        problems.append(f"several circuits carry current: {listed}; femfit has one. Set the others to 0 A.")
        return None
    if others:
        names = ", ".join(repr(circuit.name) for circuit in others)
        findings.append(Finding("idle-circuits", "info", f"Circuits without current are left out: {names}."))
    return chosen[0]


def _joined(
    blocks: Sequence[FemFace], circuit: FemCircuit, problems: list[str], findings: list[Finding]
) -> FemWinding | None:
    polygon = shapely.unary_union([block.polygon for block in blocks], grid_size=GRID)
    places = ", ".join(block.label.place for block in blocks)
    if not isinstance(polygon, Polygon) or polygon.interiors:
        problems.append(
            f"the winding of circuit {circuit.name!r} must be one region without holes; its blocks do not touch, or "
            f"enclose something: {places}. Join them, or model the larger one."
        )
        return None
    densities = [block.label.turns / block.polygon.area for block in blocks]
    if max(densities) - min(densities) > DENSITY_TOLERANCE * max(abs(value) for value in densities):
        shown = ", ".join(f"{value:.4g}" for value in densities)
        problems.append(
            f"the winding of circuit {circuit.name!r} must have the same turns per area throughout; its blocks have "
            f"{shown} per mm^2: {places}. Spread the turns by area."
        )
        return None
    material = blocks[0].label.material
    if material is None:
        return None
    turns = sum(block.label.turns for block in blocks)
    if abs(turns) == 1 and material.conductivity and material.lamination_type < PLAIN_WIRE:
        findings.append(
            Finding(
                "solid-turn",
                "warning",
                f"{blocks[0].label.place} is one solid turn: FEMM lets its current density fall as 1/r, femfit takes "
                "it uniform.",
                "Expect a difference that grows with the winding's outer over its inner radius.",
            )
        )
    return FemWinding(polygon, turns, circuit, material, tuple(block.label.place for block in blocks))
