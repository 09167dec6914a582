"""A FEMM model as an actuator file: read, divide into parts, place, write, and read back.

Axes for a sweep of an imported model that its drawing leaves room for.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shapely import unary_union

from femfit.core.errors import ActuatorFileError, FemFileError
from femfit.core.results import Finding
from femfit.device.checks import CONTACT, swept
from femfit.device.decimals import scaled
from femfit.device.load import actuator_from_toml
from femfit.device.parts import Actuator
from femfit.tables.femm.faces import find_faces
from femfit.tables.femm.frame import FemDevice, FemFrame, find_frame, trim_windings
from femfit.tables.femm.model import FemModel, check_limits, in_terms_of_femfit
from femfit.tables.femm.movers import FemBodies, divide, outline_of
from femfit.tables.femm.options import FemOptions, Notes
from femfit.tables.femm.parse import parse_fem
from femfit.tables.femm.parts import drop_surroundings, merge_parts
from femfit.tables.femm.toml import actuator_toml
from femfit.tables.femm.winding import FemWinding, find_windings, find_wire

STEPS_MM = (20.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01)
"""Ways that are tried from the file's own distance, the longest first; none beyond the moving part's own size."""

POINTS = 10
"""Steps of the distances that are offered."""


def offered_axes(device: FemDevice) -> str:
    """Options for a sweep around the file's own point in which nothing collides."""
    axes = []
    nearer, farther = (_free_way(device, sign) for sign in (-1.0, 1.0))
    drawn = device.frame.distance_mm
    if nearer + farther > 0:
        start, stop = round(drawn - nearer, 6), round(drawn + farther, 6)
        axes.append(f"--distance-mm={start:.9g}:{stop:.9g}:{round((stop - start) / POINTS, 7):.9g}")
    if device.windings:
        current = max(abs(device.frame.current(winding)) for winding in device.windings) or 1.0
        axes.append(f"--current-A={','.join(f'{share * current:.6g}' for share in (0.0, 0.25, 0.5, 0.75, 1.0))}")
    return " ".join(axes)


def _free_way(device: FemDevice, sign: float) -> float:
    """How far the moving part can go from where it stands, nearer (-1) or farther (+1); 0 for less than 0.01 mm."""
    fixed = outline_of(device.bodies.standing)
    moving = [piece.polygon for piece in device.bodies.mover]
    _, low, radius, high = outline_of(device.bodies.mover).bounds
    for way in (way for way in STEPS_MM if way <= max(high - low, 2.0 * radius)):
        shift = sign * device.frame.up * way
        track = unary_union([swept(polygon, min(0.0, shift), max(0.0, shift)) for polygon in moving])
        if track.distance(fixed) > 2 * CONTACT:
            return way
    return 0.0


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
        return "\n".join([*lines, *(f"- {finding.marked}" for finding in self.findings)])

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
    wires = {id(coil): find_wire(coil, options, notes) for winding in windings for coil in winding.coils}
    device = FemDevice(_actuator_name(source, options), model, bodies, windings, wires, frame, options)
    text = actuator_toml(device)
    _say_changes(model, bodies, notes)
    _say_missing(device, notes)
    try:
        actuator = actuator_from_toml(text, f"the actuator file of {source}")
    except ActuatorFileError as error:
        way = "+" if frame.up > 0 else "-"
        where = f"Heights above are the actuator file's z: the file's z is {frame.face_mm:.9g} mm {way} z."
        raise ActuatorFileError(error.source, [*error.problems, where]) from error
    return ImportedFem(
        source=source,
        toml=text,
        actuator=actuator,
        currents_A=tuple(frame.current(winding) for winding in windings),
        current_signs=tuple(frame.current_sign(winding) for winding in windings),
        distance_m=scaled(frame.distance_mm),
        frame=frame,
        findings=tuple(notes.findings),
    )


def _found(model: FemModel, options: FemOptions, notes: Notes) -> tuple[tuple[FemWinding, ...], FemBodies] | None:
    """The windings and what moves; None where the drawing does not say it."""
    before = len(notes.problems)
    faces = find_faces(model, options.arc_degrees, notes)
    if len(notes.problems) > before:
        return None  # what the missing faces touch is not known
    inside = drop_surroundings(model, faces, notes)
    if inside is None:
        return None
    windings = find_windings(inside, options.circuits, notes)
    coils = [coil for winding in windings for coil in winding.coils]
    if len(coils) > 1 and options.resistance_ohm is not None:
        notes.say("circuit resistance", coils=len(coils))
    if len(notes.problems) > before:
        return None
    parts = merge_parts([face for face in inside if face.label.material.magnetic])
    bodies = divide(parts, coils, [face for face in faces if face not in inside], options, notes)
    return None if bodies is None else trim_windings(windings, bodies, notes)


def _say_changes(model: FemModel, bodies: FemBodies, notes: Notes) -> None:
    """What of the materials is not as in the file."""
    angled = [
        label
        for label in model.labels
        if label.material.coercivity and label.material.coercivity_angle not in {0.0, label.magnetization}
    ]
    if angled:
        notes.say("material-angle", name=angled[0].material.name)
    for material in dict.fromkeys(part.material for part in (*bodies.fixed, *bodies.moving)):
        dropped = len(material.curve) - len(material.rising_curve)
        if dropped:
            notes.say("curve-end", name=material.name, dropped=dropped, points=len(material.curve))


def _say_missing(device: FemDevice, notes: Notes) -> None:
    """What the file does not hold and nobody gave."""
    options = device.options
    if not (options.distances_mm or options.currents_A):
        notes.say("one-point", axes=offered_axes(device))
    if options.mass_g is None and options.density_g_per_cm3 is None:
        notes.say("assumed-mass")


def _actuator_name(source: str, options: FemOptions) -> str:
    if options.name:
        return options.name
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", Path(source).stem).strip("-_")[:60]
    return stem if re.match(r"[A-Za-z]", stem) else f"fem-{stem}".rstrip("-")
