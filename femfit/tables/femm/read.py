"""A FEMM model as an actuator file: read, divide into parts, place, write, and read back."""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import shapely
from shapely import Point

from femfit.core.amount import counted
from femfit.core.errors import ActuatorFileError, FemFileError
from femfit.core.finding import Finding
from femfit.device.decimals import scaled
from femfit.device.load import actuator_from_toml
from femfit.device.parts import Actuator
from femfit.tables.femm.faces import GRID, find_faces
from femfit.tables.femm.frame import FemFrame, find_frame
from femfit.tables.femm.limits import check_limits
from femfit.tables.femm.model import FemModel, FemPoint
from femfit.tables.femm.notes import Notes
from femfit.tables.femm.options import FemOptions
from femfit.tables.femm.parse import parse_fem
from femfit.tables.femm.parts import FemBodies, divide, merge_parts
from femfit.tables.femm.surroundings import drop_surroundings
from femfit.tables.femm.toml import actuator_toml
from femfit.tables.femm.winding import FemWinding, find_winding, find_wire


@dataclass(frozen=True)
class ImportedFem:
    """A FEMM model, imported; its own point has femfit's signs."""

    source: str
    toml: str
    actuator: Actuator
    current_A: float
    distance_m: float
    frame: FemFrame
    findings: tuple[Finding, ...]

    def __str__(self) -> str:
        lines = [f"{self.source}: {self.current_A:g} A at {1e3 * self.distance_m:g} mm"]
        return "\n".join([*lines, *(f"- {finding.marked}" for finding in self.findings)])

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "kind": "import-fem",
            "name": self.actuator.name,
            "current_A": self.current_A,
            "distance_m": self.distance_m,
            "file_face_mm": self.frame.face_mm,
            "mirrored": self.frame.up < 0,
            "current_sign": self.frame.current_sign,
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
    model = parse_fem(content, source)
    notes = Notes()
    check_limits(model, notes)
    winding, bodies, frame = _place(model, options, notes)
    if notes.problems or winding is None or bodies is None or frame is None:
        raise FemFileError(source, notes.problems)
    wire = find_wire(winding, options, notes)
    text = actuator_toml(model, bodies, winding, wire, frame, options, _actuator_name(source, options))
    _say_changes(model, bodies, options, notes)
    _say_missing(options, notes)
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
        current_A=frame.current_sign * winding.circuit.current_A + 0.0,
        distance_m=scaled(frame.distance_mm),
        frame=frame,
        findings=tuple(notes.findings),
    )


def _place(
    model: FemModel, options: FemOptions, notes: Notes
) -> tuple[FemWinding | None, FemBodies | None, FemFrame | None]:
    """Everything that is found in the drawing; None from where it cannot be gone on."""
    faces = find_faces(model, options.arc_degrees, notes)
    own = drop_surroundings(model, faces, notes) if faces else None
    winding = None if own is None else find_winding(own, options.circuit, notes)
    if own is None or winding is None:
        return None, None, None
    parts = merge_parts([face for face in own if face.label.material is not None and face.label.material.magnetic])
    air = [face for face in faces if face not in own]
    bodies = divide(parts, air, winding.polygon, options, notes)
    if bodies is None:
        return winding, None, None
    return winding, bodies, find_frame(bodies, winding, options, notes)


def _say_changes(model: FemModel, bodies: FemBodies, options: FemOptions, notes: Notes) -> None:
    """What of the drawing and its materials is not as in the file."""
    outlines = shapely.union_all([part.polygon.boundary for part in (*bodies.fixed, *bodies.moving)])
    arcs = [line for line in model.lines if line.angle and all(_on(outlines, end) for end in (line.start, line.end))]
    if arcs:
        notes.info(
            "arcs",
            f"{len(arcs)} arcs became chords of at most {options.arc_degrees:g} degrees, within "
            f"{100 * math.radians(options.arc_degrees) ** 2 / 8:.2g} % of their radius.",
            "Take finer ones with --arc-degrees.",
        )
    angled = [
        label
        for label in model.labels
        if label.material is not None
        and label.material.coercivity
        and label.material.coercivity_angle not in {0.0, label.magnetization}
    ]
    if angled:
        notes.warn(
            "material-angle",
            f"H_cAngle of {angled[0].material.name if angled[0].material else ''!r} is ignored, as format 4.0 "
            "solvers do: the block label's direction counts.",
            "Check the direction of magnetization in the actuator file.",
        )
    for material in dict.fromkeys(part.material for part in (*bodies.fixed, *bodies.moving)):
        dropped = len(material.curve) - len(material.rising_curve)
        if dropped:
            notes.info(
                "curve-end",
                f"The B-H curve of {material.name!r} ends with a slope below mu_0; its last {dropped} of "
                f"{counted(len(material.curve), 'point is', 'points are')} left out, and the curve goes on with mu_0.",
            )


def _say_missing(options: FemOptions, notes: Notes) -> None:
    """What the file does not hold and nobody gave."""
    if not (options.distances_mm or options.currents_A):
        notes.info(
            "one-point",
            "The sweep holds the file's own point alone.",
            "For a table to fit give axes, such as --distance-mm 2:20:0.5 --current-A 0:2:0.5.",
        )
    if options.mass_g is None and options.density_g_per_cm3 is None:
        notes.warn(
            "assumed-mass",
            "The file has no mass; it is the volume of the moving part times an assumed density.",
            "Give --mass-g, or --density-g-per-cm3; force and flux do not depend on it.",
        )


def _on(outlines: shapely.Geometry, point: FemPoint) -> bool:
    return bool(outlines.distance(Point(point.r, point.z)) <= GRID)


def _actuator_name(source: str, options: FemOptions) -> str:
    if options.name:
        return options.name
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", Path(source).stem).strip("-_")[:60]
    return stem if re.match(r"[A-Za-z]", stem) else f"fem-{stem}".rstrip("-")
