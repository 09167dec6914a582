"""The winding of a FEMM model: the blocks of one circuit as one region of uniform current density, and its wire."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import shapely
from shapely import Polygon

from femfit.device.winding import smallest_winding_area, wire_resistance
from femfit.tables.femm.faces import GRID, FemFace
from femfit.tables.femm.model import FemCircuit, FemMaterial
from femfit.tables.femm.notes import Notes
from femfit.tables.femm.options import FemOptions

DENSITY_TOLERANCE = 1e-3
"""Relative difference of the turns per area of two blocks that still counts as one winding."""

PLAIN_WIRE = 3
"""``LamType`` of round magnet wire; it and above are wound, below are solid."""

COPPER_FILL = 0.5
"""Copper in a winding's section, usual for round wire (geometry/plunger-solenoid.toml has 0.53)."""


@dataclass(frozen=True)
class FemWinding:
    """A winding, with its section in the file's coordinates in mm."""

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


def find_winding(faces: Sequence[FemFace], name: str | None, notes: Notes) -> FemWinding | None:
    """The winding among the faces; None if there is none that can be taken."""
    circuit = _chosen(faces, name, notes)
    if circuit is None:
        return None
    blocks = [face for face in faces if face.label.circuit == circuit]
    before = len(notes.problems)
    if circuit.kind != 1:
        notes.problem(
            f"circuit {circuit.name!r} is parallel (solid conductors); femfit's winding has uniform current density. "
            "Make it series and give its block the number of turns."
        )
    for block in blocks:
        material = block.label.material
        if material is not None and material.magnetic:
            notes.problem(f"{block.label.place} is magnetic and in circuit {circuit.name!r}. Wind it with copper.")
        if block.label.turns == 0:
            notes.problem(f"{block.label.place} has no turns in circuit {circuit.name!r}. Give their number.")
    if len(notes.problems) > before:
        return None
    return _joined(blocks, circuit, notes)


def _chosen(faces: Sequence[FemFace], name: str | None, notes: Notes) -> FemCircuit | None:
    circuits = list(dict.fromkeys(face.label.circuit for face in faces if face.label.circuit is not None))
    if not circuits:
        notes.problem("no block belongs to a circuit; femfit needs a winding. Assign a series circuit and turns.")
        return None
    listed = ", ".join(f"{circuit.name!r} ({circuit.current_A:g} A)" for circuit in circuits)
    chosen = [circuit for circuit in circuits if circuit.name == name] if name else circuits
    if not name and len(circuits) > 1:
        chosen = [circuit for circuit in circuits if circuit.current_A] or circuits
    if len(chosen) != 1:
        what = f"no circuit is named {name!r}" if name and not chosen else "several circuits could be the winding"
        notes.problem(f"{what}: {listed}. Name one with --circuit; the others must carry 0 A.")
        return None
    others = [circuit for circuit in circuits if circuit != chosen[0]]
    if any(circuit.current_A for circuit in others):
        notes.problem(f"several circuits carry current: {listed}; femfit has one. Set the others to 0 A.")
        return None
    if others:
        names = ", ".join(repr(circuit.name) for circuit in others)
        notes.info("idle-circuits", f"Circuits without current are left out: {names}.")
    return chosen[0]


def _joined(blocks: Sequence[FemFace], circuit: FemCircuit, notes: Notes) -> FemWinding | None:
    polygon = shapely.unary_union([block.polygon for block in blocks], grid_size=GRID)
    places = ", ".join(block.label.place for block in blocks)
    if not isinstance(polygon, Polygon) or polygon.interiors:
        notes.problem(
            f"the winding of circuit {circuit.name!r} must be one region without holes; its blocks do not touch, or "
            f"enclose something: {places}. Join them, or model the larger one."
        )
        return None
    densities = [block.label.turns / block.polygon.area for block in blocks]
    if max(densities) - min(densities) > DENSITY_TOLERANCE * max(abs(value) for value in densities):
        shown = ", ".join(f"{value:.4g}" for value in densities)
        notes.problem(
            f"the winding of circuit {circuit.name!r} must have the same turns per area throughout; its blocks have "
            f"{shown} per mm^2: {places}. Spread the turns by area."
        )
        return None
    material = blocks[0].label.material
    if material is None:
        return None
    turns = sum(block.label.turns for block in blocks)
    if abs(turns) == 1 and material.conductivity and material.lamination_type < PLAIN_WIRE:
        notes.warn(
            "solid-turn",
            f"{blocks[0].label.place} is one solid turn: FEMM lets its current density fall as 1/r, femfit takes "
            "it uniform.",
            "Expect a difference that grows with the winding's outer over its inner radius.",
        )
    return FemWinding(polygon, turns, circuit, material, tuple(block.label.place for block in blocks))


@dataclass(frozen=True)
class FemWire:
    """What an actuator file says of the wire; a resistance without an origin follows from the diameter, at 20 degC."""

    resistance_ohm: float
    resistance_origin: str = ""
    diameter_mm: float | None = None
    diameter_origin: str = ""


def find_wire(winding: FemWinding, options: FemOptions, notes: Notes) -> FemWire:
    """The winding's wire and resistance: the user's, the file's, or an assumption that is called one."""
    diameter, origin = options.wire_diameter_mm, "given"
    if diameter is None and winding.round_wire and _fits(winding, winding.material.wire_diameter_mm):
        diameter, origin = winding.material.wire_diameter_mm, f"WireD of {winding.material.name!r}"
    if options.resistance_ohm is not None:
        return FemWire(options.resistance_ohm, "given", diameter, origin)
    if diameter is None and winding.wire_resistance_ohm is not None:
        return FemWire(winding.wire_resistance_ohm, f"the wire and conductivity of {winding.material.name!r}")
    if diameter is None:
        section = COPPER_FILL * winding.polygon.area / abs(winding.turns)
        diameter = float(f"{2.0 * math.sqrt(section / math.pi):.3g}")
        origin = f"ASSUMED: the file has no wire that fits; {100 * COPPER_FILL:g} % of the winding is copper"
        notes.warn(
            "assumed-wire",
            f"The file says nothing of the wire; {diameter:g} mm is assumed ({100 * COPPER_FILL:g} % copper).",
            "Give --wire-diameter-mm or --resistance-ohm; force and flux do not depend on it.",
        )
    resistance = wire_resistance(abs(winding.turns), winding.polygon.centroid.x * 1e-3, diameter * 1e-3)
    return FemWire(resistance, "", diameter, origin)


def _fits(winding: FemWinding, diameter: float) -> bool:
    return bool(smallest_winding_area(abs(winding.turns), diameter) <= winding.polygon.area)
