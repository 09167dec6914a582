"""What a FEMM magnetics file says: frozen data, lengths in mm, indices resolved to the objects that they name."""

from dataclasses import dataclass

from femfit.core.numerics import MU_0

TOLERANCE = 0.01
"""dB/dH below mu_0 by more than this is no rounding; actuator files have the same limit."""

FEWEST = 3
"""Points that a curve keeps."""

NON_MAGNETIC = 1e-3
"""Deviation of mu_r from 1 below which a material is taken as air; the actuator's own limit."""


@dataclass(frozen=True)
class FemMaterial:
    """A block property.

    A linear magnet has B = mu_0 mu_r (H + H_c), H_c in A/m; its own angle is what format 4.0 solvers leave out for the
    block label's. Lamination types from 3 on are kinds of wire. The curve has points (B in T, H in A/m), or none.
    """

    name: str
    mu_x: float = 1.0
    mu_y: float = 1.0
    coercivity: float = 0.0
    coercivity_angle: float = 0.0
    current_density: float = 0.0
    conductivity: float = 0.0
    lamination_type: int = 0
    lamination_fill: float = 1.0
    strands: int = 0
    wire_diameter_mm: float = 0.0
    curve: tuple[tuple[float, float], ...] = ()

    @property
    def remanence(self) -> float:
        """B_r = mu_0 mu_r H_c in T, without sign."""
        return MU_0 * self.mu_y * abs(self.coercivity)

    @property
    def rising_curve(self) -> tuple[tuple[float, float], ...]:
        """The curve without its last points as long as it ends with a slope below mu_0.

        Library curves are extrapolated by hand far into saturation, and there some rise more slowly than vacuum. FEMM
        smooths such a curve; here it is cut, for beyond its last point the field solver goes on with mu_0 anyway.
        """
        curve = self.curve
        while len(curve) > FEWEST:
            (flux, field), (last_flux, last_field) = curve[-2:]
            if last_flux - flux >= (1.0 - TOLERANCE) * MU_0 * (last_field - field):
                break
            curve = curve[:-1]
        return curve

    @property
    def magnetic(self) -> bool:
        """Whether a field acts on it otherwise than on air."""
        return bool(self.coercivity or self.curve or max(abs(self.mu_x - 1.0), abs(self.mu_y - 1.0)) > NON_MAGNETIC)


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
    c0: float = 0.0
    c1: float = 0.0

    @property
    def drives(self) -> bool:
        """Whether it makes a field by itself."""
        return (self.kind == 0 and any((self.a0, self.a1, self.a2))) or (self.kind == 2 and self.c1 != 0.0)


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
    potential: float = 0.0
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
    """A block label with its place in the file's list, from 1; no material is a region without mesh.

    The magnetization is in degrees from the r axis, or a Lua expression; ``external`` lies in the mapped region, and
    ``default`` stands for every region without a label.
    """

    number: int
    r: float
    z: float
    material: FemMaterial | None
    circuit: FemCircuit | None = None
    turns: float = 1.0
    magnetization: float = 0.0
    direction_formula: str = ""
    group: int = 0
    external: bool = False
    default: bool = False

    @property
    def place(self) -> str:
        """How messages name it."""
        name = "<No Mesh>" if self.material is None else self.material.name
        return f"block {name!r} at (r, z) = ({self.r:g}, {self.z:g}) mm"


@dataclass(frozen=True)
class FemModel:
    """A whole file; ``previous_solution`` is the file that the solution starts from, empty for none."""

    source: str
    version: float
    problem_type: str
    frequency: float
    unit: str
    previous_solution: str
    previous_type: int
    comment: str
    points: tuple[FemPoint, ...]
    lines: tuple[FemLine, ...]
    labels: tuple[FemLabel, ...]
