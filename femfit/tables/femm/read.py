"""A FEMM model as an actuator file: read, divide into parts, place, write, and read back."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from femfit.core.errors import FemFileError
from femfit.core.results import Finding
from femfit.device.keys import scaled
from femfit.device.load import actuator_from_toml
from femfit.device.parts import Actuator
from femfit.tables.femm.faces import find_faces
from femfit.tables.femm.frame import FemDevice, FemFrame, find_frame, find_wire
from femfit.tables.femm.model import FemModel, FemOptions, Notes, check_limits, in_terms_of_femfit
from femfit.tables.femm.movers import FemBodies, divide
from femfit.tables.femm.parse import parse_fem
from femfit.tables.femm.parts import FemWinding, drop_surroundings, find_windings, merge_parts
from femfit.tables.femm.toml import actuator_toml


@dataclass(frozen=True)
class ImportedFem:
    """A FEMM model, imported; its own point has femfit's signs, with one current a circuit."""

    source: str
    toml: str
    actuator: Actuator
    currents_A: tuple[float, ...]
    current_signs: tuple[float, ...]
    distance_m: float
    frame: FemFrame
    findings: tuple[Finding, ...]

    @property
    def current_A(self) -> float:  # noqa: N802  the unit, as in actuator files
        """Of the first circuit; zero where there is none."""
        return self.currents_A[0] if self.currents_A else 0.0

    def __str__(self) -> str:
        currents = ", ".join(f"{current:g} A" for current in self.currents_A) or "no current"
        lines = [f"{self.source}: {currents} at {1e3 * self.distance_m:g} mm"]
        ordered = sorted(self.findings, key=lambda finding: finding.severity == "info")
        return "\n".join([*lines, *(f"- {finding.marked}" for finding in ordered)])

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "kind": "import-fem",
            "name": self.actuator.name,
            "current_A": self.current_A,
            "currents_A": dict(zip((circuit.name for circuit in self.actuator.circuits), self.currents_A, strict=True)),
            "distance_m": self.distance_m,
            "file_face_mm": self.frame.face_mm,
            "mirrored": self.frame.up < 0,
            "current_sign": self.current_signs[0] if self.current_signs else 1.0,
            "field_sign": self.frame.field_sign,
            "findings": [finding.as_dict() for finding in self.findings],
        }


def import_fem_file(path: Path, options: FemOptions | None = None) -> ImportedFem:
    """Read a FEMM ``.fem`` file as an actuator file."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FemFileError(
            str(path), [f"it cannot be read: {error.strerror}. Give the path of a .fem file."]
        ) from error
    return import_fem(content, path.name, options)


def import_fem(content: bytes, source: str, options: FemOptions | None = None) -> ImportedFem:
    """Read a FEMM model as an actuator file."""
    options = options or FemOptions()
    notes = Notes()
    model = in_terms_of_femfit(parse_fem(content, source), notes)
    check_limits(model, notes)
    divided = _found(model, options, notes)
    if notes.problems or divided is None:
        raise FemFileError(source, notes.problems)
    windings, bodies = divided
    frame = find_frame(bodies, windings, options, notes)
    wires = {id(coil): find_wire(coil, notes) for winding in windings for coil in winding.coils}
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", Path(source).stem).strip("-_")[:60]
    name = stem if re.match(r"[A-Za-z]", stem) else f"fem-{stem}".rstrip("-")
    device = FemDevice(name, model, bodies, windings, wires, frame)
    text = actuator_toml(device)
    notes.say("one-point")
    notes.say("assumed-mass")
    return ImportedFem(
        source=source,
        toml=text,
        actuator=actuator_from_toml(text, f"the actuator file of {source}"),
        currents_A=tuple(frame.current(winding) for winding in windings),
        current_signs=tuple(frame.current_sign(winding) for winding in windings),
        distance_m=scaled(frame.distance_mm),
        frame=frame,
        findings=tuple(notes.findings),
    )


def _found(model: FemModel, options: FemOptions, notes: Notes) -> tuple[tuple[FemWinding, ...], FemBodies] | None:
    """The windings and what moves; None where the drawing does not say it."""
    before = len(notes.problems)
    faces = find_faces(model, notes)
    if len(notes.problems) > before:
        return None  # what the missing faces touch is not known
    inside = drop_surroundings(model, faces, notes)
    if inside is None:
        return None
    windings = find_windings(inside, notes)
    coils = [coil for winding in windings for coil in winding.coils]
    if len(notes.problems) > before:
        return None
    parts = merge_parts([face for face in inside if face.material.magnetic])
    bodies = divide([*parts, *coils], [face for face in faces if face not in inside], options, notes)
    return None if bodies is None else (windings, bodies)
