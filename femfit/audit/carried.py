"""Where the supply can balance the moving part's weight, the one answer of the audit and of the report."""

from dataclasses import dataclass

import numpy as np

from femfit.core.amount import amount
from femfit.core.arrays import FloatArray
from femfit.core.constants import COPPER_TEMPERATURE_COEFFICIENT
from femfit.device.parts import REFERENCE_TEMPERATURE
from femfit.model.actuator_model import ActuatorModel

COLD_C = REFERENCE_TEMPERATURE

WARM_C = 100.0
"""Temperature of a warm coil (conventional): 80 K above 20 degC, and just within thermal class 105 of IEC 60085."""

_DISTANCES = 601


@dataclass(frozen=True)
class CarriedRange:
    """The distances at which a supply's currents can balance the weight, with the coil at one temperature."""

    coil_C: float
    voltage_max_V: float
    # What the supply gives, as far as the model goes
    current_min_A: float
    current_max_A: float
    supply_A: float  # The supply's largest current, where the model ends below it; else ``current_max_A``
    weight_N: float
    # None where the weight is carried nowhere
    low_m: float | None
    high_m: float | None
    step_m: float  # Step of the distances at which the two were found
    sprung: bool = False  # Whether springs or a load act beside the weight

    def __str__(self) -> str:
        if self.supply_A > self.current_max_A:
            feed = f"{amount(self.current_max_A, 'A')}, where the model ends below the supply's current,"
        else:
            feed = f"{self.voltage_max_V:g} V with the coil at {self.coil_C:g} °C"
        weight = f"the moving part's weight of {amount(self.weight_N, 'N', 3)}"
        weight += " with its springs and load" if self.sprung else ""
        if self.low_m is None or self.high_m is None:
            return f"{feed} can balance {weight} nowhere"
        return f"{feed} can balance {weight} from {amount(self.low_m, 'm', 3)} to {amount(self.high_m, 'm', 3)}"


def resistance_at(cold_ohm: float, celsius: float) -> float:
    """Resistance of a copper winding, from that at 20 degC."""
    return cold_ohm * (1.0 + COPPER_TEMPERATURE_COEFFICIENT * (celsius - REFERENCE_TEMPERATURE))


def carried_range(model: ActuatorModel, celsius: float = COLD_C) -> CarriedRange:
    """Where some current of the supply makes the force equal the weight."""
    circuit, motion, box = model.require_circuit(), model.require_motion(), model.validity
    ohm = resistance_at(circuit.resistance_ohm, celsius)
    lowest = float(np.clip(circuit.voltage_min_V / ohm, box.current_min_A, box.current_max_A))
    highest = float(np.clip(circuit.voltage_max_V / ohm, box.current_min_A, box.current_max_A))
    d = np.linspace(box.distance_min_m, box.distance_max_m, _DISTANCES)
    needed = motion.static_force(d)
    weight = motion.mass_kg * motion.gravity_m_s2
    ends = (lowest, *model.attracting_range(lowest, highest))  # steel is attracted by either sign of the current
    forces = [model.magnetics.force(d, np.full_like(d, i)) for i in ends]
    held: FloatArray = d[(np.min(forces, axis=0) <= needed) & (np.max(forces, axis=0) >= needed)]
    low, high = (float(held[0]), float(held[-1])) if len(held) else (None, None)
    sprung = bool(motion.springs or motion.load_N)
    supply = max(circuit.voltage_max_V / ohm, highest)
    supply = supply if supply > highest * (1.0 + 1e-9) else highest
    return CarriedRange(
        celsius, circuit.voltage_max_V, lowest, highest, supply, weight, low, high, float(d[1] - d[0]), sprung
    )
