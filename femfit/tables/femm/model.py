"""What a FEMM magnetics file says: frozen data, lengths in mm, indices resolved to the objects that they name.

What a user can say where the file does not say it; what it may hold and an actuator file cannot say, each with the
remedy; and what of it is taken in another form: lamination.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NoReturn

from femfit.core.errors import FemFileError
from femfit.core.numerics import MU_0
from femfit.core.results import Finding
from femfit.device.materials import without_flat_end
from femfit.tables.findings import finding

NON_MAGNETIC = 1e-3
"""Deviation of mu_r from 1 below which a material is taken as air; the actuator's own limit."""


@dataclass(frozen=True)
class FemMaterial:
    """A block property.

    A linear magnet has B = mu_0 mu_r (H + H_c), H_c in A/m. Lamination types from 3 on are kinds of wire. The curve has
    points (B in T, H in A/m), or none.
    """

    name: str
    mu_x: float = 1.0
    mu_y: float = 1.0
    coercivity: float = 0.0
    current_density: float = 0.0
    lamination_type: int = 0
    lamination_fill: float = 1.0
    wire_diameter_mm: float = 0.0
    curve: tuple[tuple[float, float], ...] = ()

    @property
    def remanence(self) -> float:
        """B_r = mu_0 mu_r H_c in T, without sign."""
        return MU_0 * self.mu_y * abs(self.coercivity)

    @property
    def magnetic(self) -> bool:
        """Whether a field acts on it otherwise than on air."""
        return bool(self.coercivity or self.curve or max(abs(self.mu_x - 1.0), abs(self.mu_y - 1.0)) > NON_MAGNETIC)


NO_MESH = FemMaterial("<No Mesh>")
"""The material of a region that is not solved."""


@dataclass(frozen=True)
class FemBoundary:
    """A boundary property.

    Of kind 0 prescribed A (a0 + a1 r + a2 z), 2 mixed ((1/mu) dA/dn + c0 A + c1 = 0), 3 dual image, 4 and 5 periodic.
    """

    name: str
    kind: int = 0
    a0: float = 0.0
    a1: float = 0.0
    a2: float = 0.0
    c1: float = 0.0


@dataclass(frozen=True)
class FemCircuit:
    """A circuit property: the real part of its current, and kind 1 where its blocks are windings in series."""

    name: str
    current_A: float = 0.0
    kind: int = 1


@dataclass(frozen=True)
class FemPointProperty:
    """A point property: a filament's current, or a prescribed A where there is none."""

    name: str
    current_A: float = 0.0


@dataclass(frozen=True)
class FemPoint:
    """A node of the drawing, in mm."""

    r: float
    z: float
    property: FemPointProperty | None = None


@dataclass(frozen=True)
class FemLine:
    """A segment, or an arc of ``angle`` degrees that runs counter-clockwise from its start."""

    start: FemPoint
    end: FemPoint
    angle: float = 0.0
    boundary: FemBoundary | None = None


@dataclass(frozen=True)
class FemLabel:
    """A block label with its place in the file's list, from 1.

    The magnetization is in degrees from the r axis, or a Lua expression; ``external`` lies in the mapped region, and
    ``default`` stands for every region without a label.
    """

    number: int
    r: float
    z: float
    material: FemMaterial
    circuit: FemCircuit | None = None
    turns: float = 1.0
    magnetization: float = 0.0
    direction_formula: str = ""
    group: int = 0
    external: bool = False
    default: bool = False

    @property
    def meshed(self) -> bool:
        """Whether its region is solved."""
        return self.material != NO_MESH

    @property
    def place(self) -> str:
        """How messages name it."""
        return f"block {self.material.name!r} at (r, z) = ({self.r:g}, {self.z:g}) mm"


@dataclass(frozen=True)
class FemModel:
    """A whole file."""

    source: str
    problem_type: str
    frequency: float
    unit: str  # Empty where the file names none; FEMM takes inches
    comment: str
    points: tuple[FemPoint, ...]
    lines: tuple[FemLine, ...]
    labels: tuple[FemLabel, ...]


@dataclass(frozen=True)
class FemOptions:
    """Choices and values that a ``.fem`` file does not hold, as the command's options of the same names say them.

    Moving bodies are named by the number of one of their block labels; the face's height is in the file's z.

    Attributes
    ----------
    moving_labels : sequence of int
        Place in the file's list, from 1, of a block label in the body that moves; inferred by default.
    mover_side : {'auto', 'above', 'below'}
        Side of the fixed parts on which the moving part stands in the file: higher or lower z.
    face_mm : float or None
        Height z, in the file, of the fixed parts' face from which distances are counted.
    """

    moving_labels: tuple[int, ...] = ()
    mover_side: Literal["auto", "above", "below"] = "auto"
    face_mm: float | None = None


@dataclass(frozen=True)
class Notes:
    """Filled by the steps of an import, each in its turn."""

    source: str
    findings: list[Finding] = field(default_factory=list)

    @property
    def problems(self) -> list[str]:
        """What refuses the model, when everything was looked at."""
        return [str(remark) for remark in self.findings if remark.severity == "error"]

    def say(self, key: str, /, **facts: Any) -> None:
        """Remark on the model by a key of ``findings.toml``."""
        self.findings.append(finding(key, **facts))

    def settle(self, before: int = 0) -> None:
        """Refuse the model where more was wrong than before."""
        if len(self.problems) > before:
            raise FemFileError(self.source, self.problems)

    def stop(self, key: str, /, **facts: Any) -> NoReturn:
        """Refuse the model for what nothing can be gone on without."""
        self.say(key, **facts)
        raise FemFileError(self.source, self.problems)


ANGLE_TOLERANCE = 0.01
"""Degrees within which a magnetization is along an axis: drawings give 90 or -90, rotated ones its rounding."""

SIGNIFICANT_SHARE = 1e-6
"""Relative difference of two permeabilities below which they are the same number, rounded."""


Direction = tuple[float, float]
"""Unit vector (r, z)."""


def magnet_direction(label: FemLabel) -> Direction | None:
    """Where a block's magnetization points; None for no magnet. A negative H_c turns the magnet round."""
    if not label.material.coercivity:
        return None
    angle = (label.magnetization + (0.0 if label.material.coercivity > 0 else 180.0)) % 360.0
    along = 90.0 * round(angle / 90.0)  # one of the axes
    angle = along if abs(angle - along) <= ANGLE_TOLERANCE else angle
    r, z = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    return round(r, 12) + 0.0, round(z, 12) + 0.0


def with_limits(model: FemModel, notes: Notes) -> FemModel:
    """The model with materials that an actuator file can hold; what cannot be taken of its properties is reported."""
    if model.frequency:
        notes.say("frequency", frequency=model.frequency)
    if not model.unit:
        notes.say("inches")
    used = [label for label in model.labels if label.meshed and not label.external]
    taken = {label.material: label.material for label in used}
    for material in taken:
        taken[material] = _solid(_rising(material, notes), notes)
    if model.problem_type != "axisymmetric":
        notes.say("kind planar", kind=model.problem_type[:40])
    names: list[str] = []
    for material in dict.fromkeys(taken.values()):
        _check_material(material, notes)
        if material.name in names:
            notes.say("material twice", name=material.name)
        names.append(material.name)
    for label in used:
        if label.material.coercivity and label.direction_formula:
            notes.say("label formula", place=label.place, formula=label.direction_formula)
    for point in model.points:
        held = point.property
        if held and (held.current_A or point.r > 0):
            notes.say("point", name=held.name, r=point.r, z=point.z)
    labels = (replace(label, material=taken.get(label.material, label.material)) for label in model.labels)
    return replace(model, labels=tuple(labels))


def _check_material(material: FemMaterial, notes: Notes) -> None:
    name, mu_x, mu_y = material.name, material.mu_x, material.mu_y
    if min(mu_x, mu_y) <= 0:
        notes.say("material permeability", name=name, mu=min(mu_x, mu_y))
    elif material.coercivity and material.curve:
        notes.say("material magnet", name=name)
    elif abs(mu_x - mu_y) > SIGNIFICANT_SHARE * mu_x and not material.curve:
        notes.say("material anisotropic", name=name, mu_x=mu_x, mu_y=mu_y)
    if material.lamination_type in {0, 1, 2} and material.lamination_fill != 1.0 and material.magnetic:
        notes.say("material laminated", name=name, fill=material.lamination_fill)


def _rising(material: FemMaterial, notes: Notes) -> FemMaterial:
    """The material without the last points of its curve as long as that ends with a slope below mu_0.

    Library curves are extrapolated by hand far into saturation, and there some rise more slowly than vacuum. FEMM
    smooths such a curve; here it is cut, for beyond its last point the field solver goes on with mu_0 anyway.
    """
    if not material.curve:
        return material
    flux_density, field_strength = zip(*material.curve, strict=True)
    points, _ = without_flat_end(flux_density, field_strength, least=0.0)
    curve = tuple(zip(*points, strict=True))
    if dropped := len(material.curve) - len(curve):
        notes.say("curve-end", name=material.name, dropped=dropped, points=len(material.curve))
    return replace(material, curve=curve)


def _solid(material: FemMaterial, notes: Notes) -> FemMaterial:
    """Sheets in the plane of the drawing with gaps between them, B = s B_sheet + (1 - s) mu_0 H."""
    fill = material.lamination_fill
    if material.lamination_type != 0 or not 0.0 < fill < 1.0 or not material.magnetic:
        return material
    notes.say("lamination", name=material.name, fill=fill)
    return replace(
        material,
        mu_x=fill * material.mu_x + 1.0 - fill,
        mu_y=fill * material.mu_y + 1.0 - fill,
        curve=tuple((fill * flux + (1.0 - fill) * MU_0 * field, field) for flux, field in material.curve),
        lamination_fill=1.0,
    )
