"""A bench campaign on an actuator model: what an engineer would have measured, had the model been the actuator.

The winding warms with the current and its resistance follows copper; the body is put back by hand between runs; meters
have correlated noise and 12-bit converters; temperatures are read by probes.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.model.actuator_model import ActuatorModel
from femfit.trial.campaign.noise import Meter, measured
from femfit.trial.truth.thermal import COPPER_PER_K, REFERENCE_C, ThermalNetwork, heat

_PROBE_C = 0.05
"""Standard deviation of a temperature probe."""


@dataclass(frozen=True)
class VirtualBench:
    """A bench and what is done on it.

    Parameters
    ----------
    runs, distances, currents : int
        Every run visits every distance; at each the current rises in so many steps and falls again.
    mount_m : float
        Standard deviation of where the body comes back to between runs.
    noise : mapping of str to float
        Standard deviation of a reading, over the channel's span.
    """

    runs: int = 4
    distances: int = 8
    currents: int = 7
    mount_m: float = 20e-6
    step_s: float = 5.0
    network: ThermalNetwork = field(
        default_factory=lambda: ThermalNetwork(30.0, 300.0, 1500.0, 300.0, 0.1, 0.3, REFERENCE_C)
    )
    noise: Mapping[str, float] = field(
        default_factory=lambda: {
            "force_N": 2e-3, "flux_linkage_Wb": 1e-3, "hall_V": 1e-3, "voltage_V": 1e-3
        }
    )  # fmt: skip
    correlation: float = 0.3


def measure(truth: ActuatorModel, bench: VirtualBench, random: np.random.Generator) -> pd.DataFrame:
    """Measure a model as if it were an actuator.

    Parameters
    ----------
    truth : ActuatorModel
        With circuit, whose resistance holds at ``coil_temperature_C``; the Hall output is read where it has a sensor.
    """
    box = truth.validity
    cold = truth.require_circuit().resistance_ohm / _copper(np.asarray(truth.coil_temperature_C))
    margin = 0.02 * (box.distance_max_m - box.distance_min_m)
    distance = np.round(np.geomspace(box.distance_min_m + margin, box.distance_max_m - margin, bench.distances), 6)
    rising = np.round(np.linspace(box.current_min_A, box.current_max_A, bench.currents), 6)
    cycle, branch = np.concatenate([rising, rising[::-1]]), np.repeat([1, -1], bench.currents)
    count = bench.distances * len(cycle)
    run = np.repeat(np.arange(bench.runs), count)
    rows = pd.DataFrame(
        {
            "run": run + 1,
            "mount": run + 1,
            "order": np.arange(count * bench.runs) + 1,
            "current_A": np.tile(cycle, bench.distances * bench.runs),
            "distance_m": np.tile(np.repeat(distance, len(cycle)), bench.runs),
            "branch": np.tile(branch, bench.distances * bench.runs),
        }
    )
    ambient = bench.network.ambient_C + random.normal(0.0, 1.0, bench.runs)[run]
    current = rows["current_A"].to_numpy()
    warm = heat(bench.network, current, run, ambient, bench.step_s)
    for name, true in (("coil_temperature_C", warm.coil), ("magnet_temperature_C", warm.magnet)):
        rows[name] = np.round(true + _PROBE_C * random.standard_normal(len(rows)), 1)
    place = rows["distance_m"].to_numpy() + random.normal(0.0, bench.mount_m, bench.runs)[run]
    state = truth.magnetics.state(place, current)
    values = {
        "force_N": state.force,
        "flux_linkage_Wb": truth.magnetics.flux_linkage(place, current),
        "voltage_V": cold * _copper(warm.coil) * current,
    }
    if truth.sensor is not None:
        values["hall_V"] = truth.sensor.voltage(place, current)
    for name, value in values.items():
        meter = Meter(bench.noise[name] * float(np.ptp(value)), bench.correlation, 1.3 * float(np.abs(value).max()))
        rows[name] = measured(value, meter, run, random)
    return rows


def _copper(temperature: FloatArray) -> FloatArray:
    """Resistance of copper over that at 20 degC."""
    return np.asarray(1.0 + COPPER_PER_K * (temperature - REFERENCE_C))
