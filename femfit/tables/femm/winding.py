"""The windings of a FEMM model: regions of uniform current density, in series with each other or on their own.

The wire of a FEMM model's windings: the user's, the file's, or an assumption that is called one.
"""

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace

from femfit.device.parts import smallest_winding_area, wire_resistance
from femfit.tables.femm.faces import FemFace, FemPiece, connected_faces, without_holes
from femfit.tables.femm.model import FemCircuit
from femfit.tables.femm.options import FemOptions, Notes

DENSITY_TOLERANCE = 1e-3
"""Relative difference of the turns per area of two blocks that touch which still counts as one winding."""

PLAIN_WIRE = 3
"""``LamType`` of round magnet wire; it and above are wound, below are solid."""


@dataclass(frozen=True)
class FemCoil(FemPiece):
    """A winding by its section; negative turns are wound the other way."""

    turns: float


@dataclass(frozen=True)
class FemWinding:
    """Coils in series, with the circuit that carries their current."""

    circuit: FemCircuit
    coils: tuple[FemCoil, ...]

    @property
    def sign(self) -> float:
        """+1 where the first coil is wound as the actuator file's, -1 where a positive current flows the other way."""
        return 1.0 if self.coils[0].turns > 0 else -1.0


def find_windings(faces: Sequence[FemFace], names: Sequence[str], notes: Notes) -> tuple[FemWinding, ...]:
    """The windings among the faces in the file's order; none for a model without current."""
    before = len(notes.problems)
    chosen = _chosen(faces, names, notes)
    windings = []
    for circuit in chosen:
        blocks = [face for face in faces if face.label.circuit == circuit]
        _check(blocks, circuit, notes)
        if len(notes.problems) == before:
            windings.append(FemWinding(circuit, _coils([(b, b.label.turns / b.polygon.area) for b in blocks])))
            _say_solid(windings[-1], notes)
    if not names:
        windings += _by_density(faces, notes)
    return () if len(notes.problems) > before else tuple(windings)


def _check(blocks: Sequence[FemFace], circuit: FemCircuit, notes: Notes) -> None:
    if circuit.kind != 1 and len(blocks) > 1:
        notes.say("circuit parallel", name=circuit.name, blocks=len(blocks))
    for block in blocks:
        material = block.label.material
        facts = {"place": block.label.place, "name": circuit.name}
        if material.magnetic:
            notes.say("circuit magnetic", **facts)
        if density := material.current_density:
            notes.say("circuit-and-density", size=density * block.polygon.area, density=density, **facts)
        if block.label.turns == 0:
            notes.say("circuit turns", **facts)


def _chosen(faces: Sequence[FemFace], names: Sequence[str], notes: Notes) -> list[FemCircuit]:
    """The circuits that are taken: those that the user names, else those with current, all of coils alone."""
    circuits = list(dict.fromkeys(face.label.circuit for face in faces if face.label.circuit is not None))
    materials = [face.label.material for face in faces]
    if not names:
        live = [circuit for circuit in circuits if circuit.current_A]
        coils_alone = not any(material.magnetic for material in materials)  # which feel no force but each other's
        driven = live or any(material.current_density for material in materials)
        taken = live if driven and not coils_alone else circuits
    else:
        taken = [circuit for circuit in circuits if circuit.name in names]
        unknown = [repr(name) for name in names if name not in {circuit.name for circuit in circuits}]
        if unknown:
            listed = ", ".join(f"{circuit.name!r} ({circuit.current_A:g} A)" for circuit in circuits) or "none"
            notes.say("circuit unknown", names=" or ".join(unknown), circuits=listed)
    omitted = [circuit for circuit in circuits if circuit not in taken]
    idle = [circuit.name for circuit in omitted if not circuit.current_A]
    if idle and taken:
        every = " ".join(f"--circuit {shlex.quote(circuit.name)}" for circuit in circuits)
        notes.say("idle-circuits", circuits=", ".join(map(repr, idle)), options=every)
    lost = [f"{circuit.name!r} ({circuit.current_A:g} A)" for circuit in omitted if circuit.current_A]
    if lost and taken:
        notes.say("left-circuits", circuits=", ".join(lost))
    return taken


def _by_density(faces: Sequence[FemFace], notes: Notes) -> list[FemWinding]:
    """A winding for each current density J: the smallest block of it is one turn of J times its area."""
    blocks = [
        (face, face.label.material.current_density)
        for face in faces
        if face.label.circuit is None and face.label.material.current_density
    ]
    for face, _ in blocks:
        if face.label.material.magnetic:
            notes.say("circuit density", place=face.label.place)
    windings = []
    for size in dict.fromkeys(abs(density) for _, density in blocks):
        alike = [(face, density) for face, density in blocks if abs(density) == size]
        coils = _coils(alike)
        current = min(abs(coil.turns) for coil in coils)  # J in MA/m^2 times mm^2 is A
        material = coils[0].material
        turns = tuple(replace(coil, turns=coil.turns / current) for coil in coils)
        windings.append(FemWinding(FemCircuit(material.name, current), turns))
        facts = {"density": material.current_density, "turns": abs(turns[0].turns), "current": current}
        notes.say("current-density", place=coils[0].place, **facts)
    return windings


def _coils(blocks: Sequence[tuple[FemFace, float]]) -> tuple[FemCoil, ...]:
    """Coils of faces with their turns per area: blocks that touch and are wound alike are one."""
    kinds: list[tuple[float, list[FemFace]]] = []
    for face, density in blocks:
        alike = (group for value, group in kinds if abs(density - value) <= DENSITY_TOLERANCE * abs(value))
        group = next(alike, None)
        if group is None:
            kinds.append((density, [face]))
        else:
            group.append(face)
    coils = []
    for _, faces in kinds:
        densities = {id(face): density for face, density in blocks}
        for section, joined in connected_faces(faces):
            turns = sum(densities[id(face)] * face.polygon.area for face in joined)
            labels = tuple(face.label for face in joined)
            material = labels[0].material
            coils += [
                FemCoil(polygon, material, labels, turns * polygon.area / section.area)
                for polygon in without_holes(section)
            ]
    return tuple(sorted(coils, key=lambda coil: coil.labels[0].number))


def _say_solid(winding: FemWinding, notes: Notes) -> None:
    for coil in winding.coils:
        material = coil.material
        solid = material.conductivity and material.lamination_type < PLAIN_WIRE
        if winding.circuit.kind != 1 or (abs(coil.turns) == 1 and solid):
            notes.say("solid-turn", place=coil.labels[0].place)


COPPER_FILL = 0.5
"""Copper in a winding's section, usual for round wire (geometry/plunger-solenoid.toml has 0.53)."""


@dataclass(frozen=True)
class FemWire:
    """What an actuator file says of the wire; a resistance without an origin follows from the diameter, at 20 degC."""

    resistance_ohm: float
    resistance_origin: str = ""
    diameter_mm: float | None = None
    diameter_origin: str = ""


def find_wire(coil: FemCoil, options: FemOptions, notes: Notes) -> FemWire:
    """A winding's wire and resistance."""
    material = coil.material
    diameter, origin = options.wire_diameter_mm, "given"
    round_wire = material.lamination_type == PLAIN_WIRE and material.wire_diameter_mm > 0.0
    if diameter is None and round_wire and _fits(coil, material.wire_diameter_mm):
        diameter, origin = material.wire_diameter_mm, f"WireD of {material.name!r}"
    if options.resistance_ohm is not None:
        return FemWire(options.resistance_ohm, "given", diameter, origin)
    resistance = _wire_resistance(coil)
    if diameter is None and resistance is not None:
        return FemWire(resistance, f"the wire and conductivity of {material.name!r}")
    if diameter is None:
        section = COPPER_FILL * coil.polygon.area / abs(coil.turns)
        diameter = float(f"{2.0 * math.sqrt(section / math.pi):.3g}")
        origin = f"ASSUMED: the file has no wire that fits; {100 * COPPER_FILL:g} % of the winding is copper"
        notes.say("assumed-wire", place=coil.labels[0].place, diameter=diameter, copper=100 * COPPER_FILL)
    resistance = wire_resistance(abs(coil.turns), coil.polygon.centroid.x * 1e-3, diameter * 1e-3)
    return FemWire(resistance, "", diameter, origin)


def _wire_resistance(coil: FemCoil) -> float | None:
    """R = N 2 pi r / (sigma s pi d^2 / 4) of wire with s strands; None where the file does not say the wire."""
    material = coil.material
    if material.lamination_type < PLAIN_WIRE or not material.wire_diameter_mm or not material.conductivity:
        return None
    section = max(material.strands, 1) * math.pi * (material.wire_diameter_mm * 1e-3) ** 2 / 4.0
    length = abs(coil.turns) * 2.0 * math.pi * coil.polygon.centroid.x * 1e-3
    return float(length / (material.conductivity * 1e6 * section))


def _fits(coil: FemCoil, diameter: float) -> bool:
    return bool(smallest_winding_area(abs(coil.turns), diameter) <= coil.polygon.area)
