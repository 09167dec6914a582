"""What an actuator is made of, in SI units, as frozen data.

Coordinates are cylindrical (r, z). The electromagnet's face, from which distances are counted, lies at
z = 0; the moving part is drawn with its own nearest face at z = 0 and extends towards positive z. At the
distance d it stands shifted by +d.
"""

from dataclasses import dataclass, replace

from femfit.core.amount import amount, amount_range
from femfit.core.constants import MU_0
from femfit.core.printed import Printed

REFERENCE_TEMPERATURE = 20.0
"""In degC, of all material values."""


@dataclass(frozen=True)
class LinearMaterial:
    """A material with H = (B - B_r) / (mu_0 mu_r)."""

    name: str
    relative_permeability: float = 1.0
    remanence_T: float = 0.0  # B_r along +z (negative: magnetised along -z); zero for everything but magnets
    # Relative change of B_r per kelvin from 20 degC, where B_r is given; zero where it is unknown
    remanence_coefficient_per_K: float = 0.0

    @property
    def reluctivity(self) -> float:
        """1 / (mu_0 mu_r) in m/H."""
        return 1.0 / (MU_0 * self.relative_permeability)

    def at_temperature(self, temperature_C: float) -> "LinearMaterial":
        """The material at a temperature, B_r (1 + alpha (T - 20 degC)); its permeability is kept.

        References
        ----------
        IEC 60404-8-1: temperature coefficient of the remanent flux density, reversible part.
        """
        factor = 1.0 + self.remanence_coefficient_per_K * (temperature_C - REFERENCE_TEMPERATURE)
        return replace(self, remanence_T=self.remanence_T * factor)


@dataclass(frozen=True)
class NonlinearMaterial:
    """A soft material that saturates: H along B, |H| a monotone function of |B|, without hysteresis."""

    name: str
    flux_density_T: tuple[float, ...]  # B of the curve's points, ascending from 0
    field_A_per_m: tuple[float, ...]  # H of the curve's points, ascending from 0
    remark: str = ""  # What was left out of the curve as it was given; empty for nothing

    @property
    def relative_permeability(self) -> float:
        """Mu_r in small fields, B / (mu_0 H) of the first point."""
        return self.flux_density_T[1] / (MU_0 * self.field_A_per_m[1])

    @property
    def remanence_T(self) -> float:  # noqa: N802  the unit, as in LinearMaterial
        """None: the curve starts at zero."""
        return 0.0


Material = LinearMaterial | NonlinearMaterial

AIR = LinearMaterial("air")


@dataclass(frozen=True)
class Region:
    """A named, closed polygon of one material."""

    name: str
    vertices_m: tuple[tuple[float, float], ...]  # Corners (r, z), without repeating the first, counter-clockwise
    material: Material


@dataclass(frozen=True)
class Coil:
    """A winding with uniform current density."""

    vertices_m: tuple[tuple[float, float], ...]  # Corners (r, z) of the winding's section
    turns: float  # Number of turns; a positive current makes +B_z on the axis
    resistance_ohm: float
    wire_diameter_m: float | None = None  # Bare copper diameter, where the file gives it


@dataclass(frozen=True)
class MovingPart:
    """The body that moves along the axis, drawn with its nearest face at z = 0."""

    regions: tuple[Region, ...]
    mass_kg: float


@dataclass(frozen=True)
class HallElement:
    """A linear Hall element measuring B_z, with its analogue output and converter."""

    # Position (r, z) of the element
    radius_m: float
    height_m: float
    sensitivity_V_per_T: float = 50.0  # Slope of the output; 50 V/T is 5 mV/G
    quiescent_V: float = 2.5
    # Range of the output and of the converter
    output_min_V: float = 0.0
    output_max_V: float = 5.0
    adc_bits: int = 12  # Resolution of the converter over that range; 0 for none
    noise_V: float = 0.0  # Standard deviation of white noise on one sample


@dataclass(frozen=True)
class Supply:
    """The driver's range and, where the file gives it, the controller's period."""

    voltage_min_V: float
    voltage_max_V: float
    sample_time_s: float | None = None


@dataclass(frozen=True)
class SweepAxes:
    """The grid of the sweep."""

    currents_A: tuple[float, ...]
    distances_m: tuple[float, ...]


@dataclass(frozen=True, repr=False)
class Actuator(Printed):
    """An electromagnet (fixed) and a body that moves along its axis.

    Parameters
    ----------
    fixed : tuple of Region
        The electromagnet's core and any other fixed part, without the winding.
    sweep : SweepAxes
        Currents and distances of the sweep.
    hall : HallElement or None
        The sensor, where there is one.
    reference_distances_m : tuple of float
        Steps of the closed-loop reference; empty: derived from the model.
    tolerance : float or None
        Relative accuracy of force and flux linkage that the field solver has to meet; None: one fixed fineness.

    Examples
    --------
    >>> import femfit as ff
    >>> actuator = ff.read_actuator("rig.toml")
    >>> actuator.moving.mass_kg, actuator.supply.voltage_max_V
    (0.00435, 3.0)
    """

    name: str
    fixed: tuple[Region, ...]
    coil: Coil
    moving: MovingPart
    supply: Supply
    sweep: SweepAxes
    hall: HallElement | None = None
    description: str = ""
    reference_distances_m: tuple[float, ...] = ()
    tolerance: float | None = None

    def __str__(self) -> str:
        coil, sweep = self.coil, self.sweep
        currents, distances = (
            f"{len(values)} {name} {amount_range(min(values), max(values), unit, 3)}"
            for values, name, unit in ((sweep.currents_A, "currents", "A"), (sweep.distances_m, "distances", "m"))
        )
        lines = [
            f"{self.name}{': ' * bool(self.description)}{self.description}",
            *(
                f"{part}: {', '.join(f'{one.name} ({one.material.name})' for one in regions) or 'nothing'}"
                for part, regions in (("fixed", self.fixed), ("moving", self.moving.regions))
            ),
            f"moving mass {amount(self.moving.mass_kg, 'kg', 3)}",
            f"coil of {coil.turns:g} turns, {amount(coil.resistance_ohm, 'ohm', 3)}",
            f"supply {self.supply.voltage_min_V:g} to {self.supply.voltage_max_V:g} V",
            f"Hall element of {amount(self.hall.sensitivity_V_per_T, 'V/T', 3)}" if self.hall else "no Hall element",
            f"sweep: {currents}, {distances}",
        ]
        return "\n".join(lines)
