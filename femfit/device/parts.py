"""What an actuator is made of, in SI units, as frozen data.

Coordinates are cylindrical (r, z). The electromagnet's face, from which distances are counted, lies at
z = 0; the moving part is drawn with its own nearest face at z = 0 and extends towards positive z. At the
distance d it stands shifted by +d. From a winding's wire follow its resistance and whether it fits; from a part's
conductivity, how deep a field enters it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Any, ClassVar

from femfit.core.errors import MissingPartError
from femfit.core.numerics import COPPER_RESISTIVITY_20C, COPPER_TEMPERATURE_COEFFICIENT, MU_0, FloatArray
from femfit.core.results import Plotted, Words
from femfit.device.electrics import TURNS, AnySensor, Circuit, HallElement
from femfit.device.keys import Entry, Outline, Record, in_same_table, key, keys_of
from femfit.device.mechanics import Mechanics
from femfit.device.thermal import STILL_AIR, UNKNOWN, Surroundings, ThermalMaterial

REFERENCE_TEMPERATURE = 20.0
"""In degC, of all material values."""

CURVE = ((0, 1000),)
"""Fewest and most points of a curve that are read, which is then checked as a whole."""


class Conductor(Record):
    """How a material of either kind conducts current and heat."""

    conductivity_S_per_m: float = key(
        "the electrical conductivity in MS/m (10^6 S/m): copper 58, mild steel 5 to 9, 0 for what does not conduct",
        0.0,
        ge=0,
        le=1e4,
        kind="conductivity",
    )
    lamination_m: float = key(
        "the thickness in mm of insulated sheets that stand radially around the axis, so that no current flows around "
        "it; 0 for a solid part and for discs",
        0.0,
        ge=0,
        le=100,
        kind="lamination",
    )
    thermal: ThermalMaterial = in_same_table(UNKNOWN)

    @classmethod
    def derived(cls, entry: Entry, complain: Callable[..., None]) -> dict[str, Any]:
        """Nothing; sheets conduct."""
        if entry.lamination_mm and not entry.conductivity_MS_per_m:
            complain("sheets")
        return {}


class LinearMaterial(Conductor, kw_only=False):
    """``[materials.NAME]``: a material with H = (B - B_r) / (mu_0 mu_r)."""

    name: str
    relative_permeability: float = key(
        "mu_r, 1 if non-magnetic; the recoil permeability of a magnet",
        1.0,
        ge=1e-6,
        le=1e7,
        required=True,
        kind="permeability",
    )
    # B_r along the direction (negative: against it); zero for everything but magnets
    remanence_T: float = key(
        "B_r in tesla (1 T = 10 kG); the direction is the region's magnetization", 0.0, ge=0, le=3, kind="remanence"
    )
    # From 20 degC, where B_r is given; zero where it is unknown
    remanence_coefficient_per_K: float = key(
        "the relative change of B_r per kelvin: -0.0012 for -0.12 %/K", 0.0, ge=-0.02, le=0.02
    )
    # Unit vector (r, z) that a positive remanence points along: (0, 1) axial, (1, 0) radial, outwards
    direction: tuple[float, float] = (0.0, 1.0)
    temperature_C: float = REFERENCE_TEMPERATURE  # Of the remanence

    @property
    def reluctivity(self) -> float:
        """1 / (mu_0 mu_r) in m/H."""
        return 1.0 / (MU_0 * self.relative_permeability)


class NonlinearMaterial(Conductor, kw_only=False):
    """``[materials.NAME]``: a soft one, H along B, |H| a monotone function of |B|, without hysteresis."""

    name: str
    # Of the curve's points
    flux_density_T: tuple[float, ...] = key(
        "ascending flux densities in tesla, from 0", file="B_T", usual=None, count=CURVE, kind="curve_flux_density"
    )
    field_A_per_m: tuple[float, ...] = key(
        "ascending fields in A/m, from 0", file="H_A_per_m", usual=None, count=CURVE, kind="curve_field"
    )
    remark: str = ""  # What was left out of the curve as it was given; empty for nothing
    bh_curve: ClassVar[str | None] = key(
        "a steel of the library, or a CSV file with columns B_T,H_A_per_m", None, min_length=1
    )

    @classmethod
    def derived(cls, entry: Entry, complain: Callable[..., None]) -> dict[str, Any]:
        """The points of its one curve, none where a file has them."""
        missing = {*CURVE_KEYS} - entry.stated
        for name in sorted(missing) if entry.bh_curve is None else ():
            complain("curve_missing", name=name)
        if entry.bh_curve is not None and len(missing) < 2:
            complain("curve_twice")
        points = {"flux_density_T": tuple(entry.B_T or ()), "field_A_per_m": tuple(entry.H_A_per_m or ())}
        return {**points, **super().derived(entry, complain)}

    @property
    def relative_permeability(self) -> float:
        """Mu_r in small fields, B / (mu_0 H) of the first point."""
        return self.flux_density_T[1] / (MU_0 * self.field_A_per_m[1])

    @property
    def remanence_T(self) -> float:  # noqa: N802  the unit, as in LinearMaterial
        """None: the curve starts at zero."""
        return 0.0


Material = LinearMaterial | NonlinearMaterial

CURVE_KEYS = tuple(name for name, declared in keys_of(NonlinearMaterial).items() if declared.kind.startswith("curve_"))
"""Of a magnetisation curve's points, in a drawing as in a table."""

AIR = LinearMaterial("air")

IRON_FROM = 1.5
"""Relative permeability from which a material without remanence counts as iron; magnets recoil with 1.05."""


def is_iron(material: Material) -> bool:
    """Whether a material is soft iron, ferrite or steel rather than a magnet or something not magnetic."""
    return not material.remanence_T and material.relative_permeability >= IRON_FROM


class Region(Outline, kw_only=False):
    """``[fixed.regions.NAME]`` or ``[moving.regions.NAME]``: a closed outline of one material."""

    needs_more = True

    name: str
    vertices_m: tuple[tuple[float, float], ...]  # Corners (r, z), without repeating the first, counter-clockwise
    material: Material
    bulges: tuple[float, ...] = ()  # Of the edge from each corner, as in femfit.device.outlines; empty: all straight
    material_name: ClassVar[str] = key("the name of a material of [materials] or of the library", file="material")
    magnetization: ClassVar[tuple[float, float] | str | None] = key(
        '"+z", "-z", "+r" (radially outwards), "-r" or a direction [r, z] for a magnet; leave it out otherwise',
        None,
        words=("+z", "-z", "+r", "-r"),
    )
    temperature_C: ClassVar[float | None] = key(
        "a magnet's temperature in degC, or leave it at 20 degC", None, ge=-273, le=500
    )


class Coil(Outline, kw_only=False):
    """``[coils.NAME]``: a winding with uniform current density."""

    needs_more = True

    vertices_m: tuple[tuple[float, float], ...]  # Corners (r, z) of the section; of a moving one as of the moving part
    # A positive current makes +B_z on the axis
    turns: float = key("the number of turns of the whole winding", **TURNS)
    resistance_ohm: float = key(
        "the resistance in ohm, or leave it to the wire", usual=None, ge=1e-9, le=1e9, kind="resistance"
    )
    wire_diameter_m: float | None = key("the bare copper diameter in mm", None, ge=1e-3, le=1e3)
    name: str = "coil"
    moves: bool = key("true for a coil that belongs to the moving part", False)
    circuit: str = "coil"  # Name of the circuit that it is connected in
    sign: float = 1.0  # Sense in which it is connected, +1 or -1
    temperature_C: float = key(
        "the winding's temperature for the resistance from the wire", REFERENCE_TEMPERATURE, ge=-200, le=500
    )


class MovingPart(Record, kw_only=False):
    """``[moving]``: the body that moves along the axis, drawn with its nearest face at z = 0, beside moving coils."""

    # None where the moving part is a coil alone
    regions: tuple[Region, ...] = key("each magnetic part of the body as [moving.regions.NAME]", ())


@dataclass(frozen=True)
class SweepAxes:
    """The grid of the sweep."""

    currents_A: tuple[float, ...]  # Of the first circuit; (0,) where there is none
    distances_m: tuple[float, ...]  # Ascending, from the fixed part's reference face; zero and below beyond it
    further_A: tuple[tuple[float, ...], ...] = ()  # Of each further circuit; all combinations are swept


@dataclass(frozen=True, repr=False)
class Actuator(Plotted):
    """Fixed parts and a body that moves along their axis, with coils on either.

    Parameters
    ----------
    fixed, coils : tuple
        Fixed regions without windings, and the windings on either part; none at all for a pair of magnets.
    sweep : SweepAxes
        Currents and distances of the sweep.
    sensors : tuple
        Of :mod:`femfit.device.electrics`.
    circuits : tuple of Circuit
        In the order of the sweep's currents; each coil names its own.
    mechanics : Mechanics
        The moving mass, and what acts on it beside the magnetic force.
    sample_time_s : float or None
        The controller's period, where the file gives it.
    reference_distances_m : tuple of float
        Steps of the closed-loop reference; empty: derived from the model.
    tolerance : float or None
        Relative accuracy of force and flux linkage that the field solver has to meet; None: one fixed fineness.
    frequencies_Hz : tuple of float
        Ascending frequencies of the impedance; empty: the field is solved at rest alone.
    eddy_error : float
        Relative error of impedance, force and Hall field that the reduced model of the eddy currents has to meet.
    thermal : Surroundings
        What its temperatures depend on beside the drawing.
    eddy_bias_A : tuple of float
        Of each circuit: about which current the fields of parts that saturate are small; empty: chosen from the sweep.

    Examples
    --------
    >>> import femfit as ff
    >>> actuator = ff.read_actuator("rig.toml")
    >>> actuator.mechanics.mass_kg, actuator.circuits[0].voltage_max_V
    (0.00435, 3.0)
    """

    name: str
    fixed: tuple[Region, ...]
    coils: tuple[Coil, ...]
    moving: MovingPart
    mechanics: Mechanics
    sweep: SweepAxes
    circuits: tuple[Circuit, ...] = ()
    sample_time_s: float | None = None
    sensors: tuple[AnySensor, ...] = ()
    description: str = ""
    reference_distances_m: tuple[float, ...] = ()
    tolerance: float | None = None
    frequencies_Hz: tuple[float, ...] = ()
    eddy_error: float = 0.01
    thermal: Surroundings = STILL_AIR
    eddy_bias_A: tuple[float, ...] = ()

    @property
    def regions(self) -> tuple[Region, ...]:
        """Fixed and moving ones, without windings."""
        return (*self.fixed, *self.moving.regions)

    @property
    def saturates(self) -> bool:
        """Whether any part does."""
        return any(isinstance(region.material, NonlinearMaterial) for region in self.regions)

    @property
    def coil(self) -> Coil:
        """The only coil.

        Raises
        ------
        MissingPartError
            If there is none, or more than one.
        """
        if len(self.coils) != 1:
            raise MissingPartError(
                f"Actuator {self.name!r} must have one coil for this; it has {len(self.coils)}. Use a drawing with "
                "one table in [coils]."
            )
        return self.coils[0]

    @property
    def hall(self) -> HallElement | None:
        """The first Hall element, if there is one."""
        return next((sensor for sensor in self.sensors if isinstance(sensor, HallElement)), None)

    @property
    def supplies_V(self) -> tuple[tuple[float, float], ...]:  # noqa: N802  the unit
        """Lowest and highest voltages behind the circuits, each pair once, where they are known."""
        limits = ((circuit.voltage_min_V, circuit.voltage_max_V) for circuit in self.circuits)
        return tuple(dict.fromkeys(pair for pair in limits if isfinite(pair[1] - pair[0])))

    def __str__(self) -> str:
        return sentence("actuator", "actuator", self)


sentence = Words("femfit.device", names={}).sentence


def copper_growth(celsius: FloatArray | float) -> FloatArray | float:
    """Copper's resistance over that at 20 degC."""
    return 1.0 + COPPER_TEMPERATURE_COEFFICIENT * (celsius - REFERENCE_TEMPERATURE)


def wire_resistance(turns: float, mean_radius: float, wire_diameter: float, temperature: float = 20.0) -> float:
    """Resistance of a copper winding, R = rho(T) N 2 pi r_mean / (pi d^2 / 4), all in SI units but T in degC.

    The mean turn length is 2 pi times the radius of the section's centroid (Pappus).

    References
    ----------
    IEC 60028 for the resistivity of annealed copper and its temperature coefficient.
    """
    resistivity = COPPER_RESISTIVITY_20C * float(copper_growth(temperature))
    return resistivity * turns * 2.0 * math.pi * mean_radius / (math.pi * wire_diameter**2 / 4.0)


def smallest_winding_area(turns: float, wire_diameter: float) -> float:
    """Area that round wires need at least, N d^2 sqrt(3)/2: the densest packing of circles fills 90.7 %.

    References
    ----------
    L. Fejes Toth, Regular Figures (1964): no packing of equal circles in a convex domain is denser.
    """
    return turns * wire_diameter**2 * math.sqrt(3.0) / 2.0


def skin_depth(material: Material, frequency_Hz: float) -> float:
    """sqrt(2 / (omega mu sigma)) in m."""
    permeability = MU_0 * material.relative_permeability
    return math.sqrt(1.0 / (math.pi * frequency_Hz * permeability * material.conductivity_S_per_m))
