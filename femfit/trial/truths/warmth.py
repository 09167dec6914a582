"""What temperatures do: to the winding, the magnets, the Hall element and the load cell."""

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.device.parts import REFERENCE_TEMPERATURE, Actuator
from femfit.trial.device import Conditions, Device, HiddenError, Readings
from femfit.trial.drawing_variants import has_magnet
from femfit.trial.truths.truth import FIELD, Truth, no_hall

COPPER_ZERO = -234.5
"""Temperature at which copper's resistance, drawn on linearly, would be zero: IEC 60028."""

Law = Literal["thermometer", "hot inside", "late"]


def lagged(values: FloatArray, at: Conditions, seconds: float) -> FloatArray:
    """A first-order lag behind values, which starts at the first one of each run."""
    result = values.copy()
    for k in range(1, len(values)):
        if at.run[k] == at.run[k - 1]:
            keep = np.exp(-(at.time_s[k] - at.time_s[k - 1]) / seconds)
            result[k] = values[k] + keep * (result[k - 1] - values[k])
    return result


def winding(law: Law) -> Truth:
    """Copper that warms, as much as its thermometer says, more inside, or before it."""

    def share(device: Device, at: Conditions) -> FloatArray:
        true = at.coil_C
        if law == "hot inside":
            rise = at.coil_C - REFERENCE_TEMPERATURE
            true = at.coil_C + rise * np.abs(rise) / 200.0
        if law == "late":
            true = at.coil_C + 3.0 * (at.current / device.largest_current) ** 2
        return (true - REFERENCE_TEMPERATURE) / (REFERENCE_TEMPERATURE - COPPER_ZERO)

    def reading(device: Device, size: float, at: Conditions, values: Readings) -> Readings:
        warm = abs(size) * device.actuator.coil.resistance_ohm * share(device, at)
        return {"voltage_V": values["voltage_V"] + warm * at.current}

    return Truth(lambda _, rng: HiddenError(lambda __: 1.3, ("voltage_V",), reading=reading))


def magnets(family: str, drawings: Callable[[Actuator], Mapping[str, Mapping[float, Actuator]]], law: Law) -> Truth:
    """Magnets that weaken as they warm: a curve of neodymium, a line of ferrite, or neodymium behind its thermometer.

    The family holds the fields by the relative change of the remanence.
    """

    def build(device: Device, rng: np.random.Generator) -> HiddenError:
        lag = float(rng.uniform(60.0, 300.0))
        slope, bend = {"thermometer": (-1.2e-3, -4e-6), "hot inside": (-2e-3, 0.0), "late": (-1.1e-3, -1e-6)}[law]

        def weaker(at: Conditions) -> FloatArray:
            rise = at.magnet_C - REFERENCE_TEMPERATURE
            rise = lagged(rise, at, lag) if law == "late" else rise
            return slope * rise + bend * rise**2

        return HiddenError(
            lambda _: 2.5,
            FIELD,
            fields=lambda device, size, at: device.change(family, abs(size) * weaker(at), at),
            constants={"lag_s": lag} if law == "late" else {},
        )

    return Truth(build, lacks=lambda drawn: "" if has_magnet(drawn) else "no magnet", families=drawings)


def hall_element(law: Law) -> Truth:
    """Zero and sensitivity of a Hall element, by the winding's temperature, the surroundings', or behind both."""

    def build(device: Device, rng: np.random.Generator) -> HiddenError:
        per_volt, lag = float(rng.uniform(-1.0, 1.0)), float(rng.uniform(30.0, 200.0))
        element = device.actuator.hall
        zero = element.quiescent_V if element else 0.0

        def reading(device: Device, size: float, at: Conditions, values: Readings) -> Readings:
            warm = {
                "thermometer": at.coil_C,
                "hot inside": 0.6 * at.coil_C + 0.4 * at.magnet_C,
                "late": lagged(at.magnet_C, at, lag),
            }[law] - REFERENCE_TEMPERATURE
            return {"hall_V": values["hall_V"] + size * warm * (1.0 + per_volt * (values["hall_V"] - zero))}

        return HiddenError(lambda _: 2e-2, ("hall_V",), reading=reading, constants={"gain_1_per_V": per_volt})

    return Truth(build, lacks=no_hall)


def load_cell(law: Literal["zero", "span", "both"]) -> Truth:
    """A load cell near the winding whose zero, or span, follows the winding's temperature late: no catalogue has it."""

    def build(device: Device, rng: np.random.Generator) -> HiddenError:
        lag = float(rng.uniform(100.0, 900.0))

        def reading(device: Device, size: float, at: Conditions, values: Readings) -> Readings:
            start = np.r_[True, np.diff(at.run) > 0]
            ambient = at.coil_C[start][np.cumsum(start) - 1]
            warm = lagged(at.coil_C - ambient, at, lag)
            zero = size * warm * (law != "span")
            span = size * warm * values["force_N"] / device.largest_force * (law != "zero")
            return {"force_N": values["force_N"] + zero + span}

        return HiddenError(
            lambda device: 0.02 * device.largest_force,
            ("force_N",),
            reading=reading,
            names=(),
            constants={"lag_s": lag},
        )

    return Truth(build, "unseen")
