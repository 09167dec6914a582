"""What is known of a reading beside its distance and current, and facts of the base model that effects scale by."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from casadi import SX

from femfit.core.graph import Expression
from femfit.core.numerics import GRAVITY

if TYPE_CHECKING:
    from femfit.effects.effect import Effect

REFERENCE_TEMPERATURE_C = 20.0
"""Where a model's remanence and resistance hold unless it says otherwise."""

TEMPERATURES = ("coil_temperature_C", "magnet_temperature_C")
"""Of what may be warm, as tables and conditions call them; NaN where it was not recorded."""

NO_MAGNET = 1e-3
"""Share of the largest force or flux linkage below which what remains without current is the fit's own error."""


@dataclass(frozen=True)
class Nominal:
    """Facts of the base model by which effects scale their parameters."""

    distance_min_m: float
    distance_max_m: float
    current_min_A: float
    current_max_A: float
    force_N: float
    flux_linkage_Wb: float
    # The larger of force and flux linkage without current, over their largest; next to 0 without a magnet
    magnet_share: float
    # Whether a drawing says if there is a magnet; otherwise force and flux linkage without current decide
    magnet_drawn: bool
    magnet_known: bool  # False without a drawing and without currents of zero in the model's table
    # NaN where the model has no circuit or no motion
    resistance_ohm: float
    mass_kg: float
    gravity_m_s2: float
    hall_quiescent_V: float  # NaN where the model has no Hall element
    # The winding's inductance, and the field of its current at the Hall element (NaN without one), in the middle of
    # the validity domain
    inductance_H: float
    hall_T_per_A: float
    # Largest departure of the Hall voltage from its quiescent value over the box; NaN without a Hall element
    hall_swing_V: float
    # Largest magnitude that the driver gives, or that holds the largest current where it is without limits; NaN where
    # the model has no circuit
    voltage_V: float
    sample_time_s: float
    # Energy of all drawn springs in J, None without, and their push away from the electromagnet in N
    springs: Callable[[Expression], Expression] | None = None
    push_of_springs: Callable[[Expression], Expression] = np.zeros_like
    stops_m: tuple[float, float] = (-np.inf, np.inf)  # Of the drawing, near and far; infinite where there is none
    circuits: tuple[str, ...] = ()  # Names of several circuits; numbers of the winding are those of the first
    magnets_apart: bool = True  # Whether the model's co-energy has a part of the magnets alone
    voltage_driver: bool = True  # False where a current amplifier feeds the winding, whatever voltage that takes
    drawn: "tuple[Effect, ...]" = field(default=(), compare=False)  # Of the numbers of the drawing
    has_iron: bool = True  # Whether a part may keep a remanent flux; true where there is no drawing

    @property
    def has_magnet(self) -> bool:
        """Whether force or flux linkage without current is more than a fit's own error may make."""
        return self.magnet_share >= NO_MAGNET

    @property
    def peak_current_A(self) -> float:  # noqa: N802 - the unit
        """The largest magnitude of the current in A."""
        return max(abs(self.current_min_A), abs(self.current_max_A))

    @property
    def travel_m(self) -> float:
        """Width of the range of distances."""
        return self.distance_max_m - self.distance_min_m

    @property
    def stiffness_N_per_m(self) -> float:  # noqa: N802 - the unit
        """Largest force over the width of the range of distances."""
        return self.force_N / self.travel_m

    def spring_energy(self, distance: Expression) -> Expression:
        """Energy of the drawn springs in J; zero without springs."""
        return 0.0 * distance if self.springs is None else self.springs(distance)

    @property
    def weight_N(self) -> float:  # noqa: N802 - the unit
        """Weight of the moving part, that on Earth where it moves level; NaN where the model has no motion."""
        return self.mass_kg * (abs(self.gravity_m_s2) or GRAVITY)


@dataclass(frozen=True, eq=False)
class Conditions:
    """What else is known of every point; each an array of shape (n,), a float that holds for all, or an expression."""

    nominal: Nominal
    branch: Expression = 0.0  # +1 while the current rises, -1 while it falls, 0 where unknown
    # NaN where it was not recorded
    coil_temperature_C: Expression = REFERENCE_TEMPERATURE_C
    magnet_temperature_C: Expression = REFERENCE_TEMPERATURE_C
    # Time since the start of the run; where a table has only ``order``, that, in readings
    time_s: Expression = 0.0
    # Time since the start of the whole campaign, over all its runs, in the unit of ``time_s``: for what does not start
    # anew with a run
    elapsed: Expression = 0.0
    frequency_Hz: Expression = np.nan  # Of the small current of an impedance; NaN where none was measured
    velocity_m_s: Expression = 0.0
    current_rate_A_s: Expression = 0.0
    motional_V: Expression = 0.0  # Voltage that the motion induces, k_m v, as the model has it
    # Whether a plant or filter asks: its temperatures are the model's, and a warming that was fitted because nobody
    # recorded the temperature has come to its end
    running: bool = False
    # Lowest and highest current of the cycle that the reading belongs to
    current_turn_A: tuple[Expression, Expression] = (0.0, 0.0)
    # Values of the effects' states; where one is missing, the effect's value at rest holds
    memory: Mapping[str, Expression] = field(default_factory=dict)
    # What effects with states recall of the order in which the readings were taken; empty where it is not known
    recalled: Mapping[str, Expression] = field(default_factory=dict)

    @property
    def numbers(self) -> dict[str, Any]:
        """What is known of a point as numbers by name, none of which is NaN for a temperature."""
        numbers = {name: getattr(self, name) for name in _PLAIN}
        for name in TEMPERATURES:
            recorded = warmth(getattr(self, name))
            numbers |= {name: recorded.kelvin, f"{name}_unknown": recorded.unknown}
        low, high = self.current_turn_A
        return {**numbers, "turn_low_A": low, "turn_high_A": high, **self.memory, **self.recalled}

    def with_numbers(self, numbers: Mapping[str, SX]) -> "Conditions":
        """The conditions with expressions in place of their :attr:`numbers`."""
        plain: dict[str, Any] = {name: numbers[name] for name in _PLAIN}
        for name in TEMPERATURES:
            plain[name] = Warmth(numbers[name], numbers[f"{name}_unknown"])
        for name in ("memory", "recalled"):
            plain[name] = {state: numbers[state] for state in getattr(self, name)}
        return replace(self, current_turn_A=(numbers["turn_low_A"], numbers["turn_high_A"]), **plain)


_PLAIN = ("branch", "time_s", "elapsed", "frequency_Hz", "velocity_m_s", "current_rate_A_s", "motional_V")
"""Conditions that are one number each."""


def like(value: Any, points: Any) -> Any:
    """A condition, given as an array or as one number, at every point; an expression as it is."""
    if isinstance(value, SX) or isinstance(points, SX):
        return value
    return np.broadcast_to(np.asarray(value, dtype=np.float64), points.shape)


@dataclass(frozen=True, eq=False)
class Warmth:
    """A recorded temperature, for arrays and expressions."""

    kelvin: Any  # Over the reference temperature; 0 where it was not recorded
    unknown: Any  # Whether it was not recorded


def warmth(temperature_C: Any) -> Warmth:
    """A condition's temperature, which may be NaN."""
    if isinstance(temperature_C, Warmth):
        return temperature_C
    kelvin = np.asarray(temperature_C, dtype=np.float64) - REFERENCE_TEMPERATURE_C
    return Warmth(np.nan_to_num(kelvin), np.isnan(kelvin))
