"""Sensing without a sensor of position, tried in simulation: an open loop, noisy readings, the filter, and its bound.

The body begins on its stop, at rest and without current; the filter begins with an estimate that is off at random by
its first deviation. Truth and filter share the model, so that the error is what noise and physics leave, not what a
wrong model adds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import FilterError, UsageError
from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.public import random_generator
from femfit.core.results import Plotted, Result
from femfit.device.electrics import Circuit
from femfit.estimate.constants import TEST_SAMPLES
from femfit.estimate.error_bound import bound_along, without_stops
from femfit.estimate.kalman_filter import kalman_filter
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.model.sensors import names_or_kinds, sampled_readings, sensor_named
from femfit.simulation.open_loop import simulate
from femfit.simulation.open_result import OpenLoop
from femfit.simulation.profile import Profile, commanded
from femfit.simulation.words import sentence

REST_S, ON_S = 0.02, 0.06
"""Conventional: time before the step of the voltage, and after it, where no drive is given."""


MOVES = "while it moves"


@dataclass(frozen=True, eq=False, repr=False)
class Sensing(Plotted, Result):
    """The distance told by a filter over an open loop; arrays have one entry a sample.

    Examples
    --------
    >>> import femfit as ff
    >>> sensing = ff.sense("model.json", sensors=("hall",), voltage_V=1.0, runs=2)
    >>> print(str(sensing).splitlines()[0])
    Distance from hall alone, 2 simulated runs:
    """

    motion: OpenLoop
    sensors: tuple[str, ...]
    runs: int
    time_s: FloatArray
    distance_m: FloatArray
    rms_m: FloatArray  # Root mean square error of the filter over the runs
    claimed_m: FloatArray  # Standard deviation that the filter says, root mean square over the runs
    bound_m: FloatArray  # That no unbiased filter without knowledge of the stops goes below

    @property
    def parts(self) -> dict[str, BoolArray]:
        """Samples before the body starts, while it moves, and after it has seated."""
        row, moving = np.arange(len(self.time_s)), np.abs(self.motion.table["velocity_m_s"][: len(self.time_s)]) > 0.0
        if not moving.any():
            return {"at rest": ~moving}
        first, last = np.flatnonzero(moving)[[0, -1]]
        between = (row >= first) & (row <= last)
        return {"before it starts": row < first, MOVES: between, "after it has come to rest": row > last}

    def __str__(self) -> str:
        return sentence("sense", "sensing", self)

    @property
    def errors(self) -> dict[str, tuple[float, float, float]]:
        """Root mean squares of error, claim and bound in m by part: over the motion, and in the last half of a rest."""
        squares, errors = self.table[["rms_m", "claimed_m", "bound_m"]] ** 2, {}
        for name, here in self.parts.items():
            rows = squares[here]
            rows = rows if name == MOVES else rows[len(rows) // 2 :]
            if len(rows):
                error, claimed, bound = np.sqrt(rows.mean()).tolist()
                errors[name] = error, claimed, bound
        return errors

    @property
    def table(self) -> pd.DataFrame:
        """The series, one row a sample."""
        names = ("time_s", "distance_m", "rms_m", "claimed_m", "bound_m")
        return pd.DataFrame({name: getattr(self, name) for name in names})

    @property
    def data(self) -> dict[str, Any]:
        """What programs read, without the series."""
        names = ("rms_m", "claimed_m", "bound_m")
        errors = {name: dict(zip(names, numbers, strict=True)) for name, numbers in self.errors.items()}
        return {"sensors": self.sensors, "runs": self.runs, "errors": errors}


def sense(
    model: ActuatorModel | str | Path,
    *,
    sensors: Sequence[str] = ("current",),
    drive: Profile | str | Path | None = None,
    voltage_V: float | None = None,
    test_voltage_V: float = 0.0,
    test_frequency_Hz: float | None = None,
    runs: int = 20,
    rng: np.random.Generator | int = 1,
) -> Sensing:
    """How well sensors tell the distance while an actuator switches: error in simulation, and bound.

    Parameters
    ----------
    sensors : sequence of str
        Sensors that the filter reads, by their names or kinds (current, position).
    drive : Profile, str, Path or None
        Command over time in place of a step, or a table with the columns time_s and voltage_V.
    voltage_V : float or None
        Height of the command's step in V, after 20 ms of rest; the supply's largest voltage by default.
    test_voltage_V : float >= 0
        Amplitude in V of a square wave on top of the command.
    test_frequency_Hz : float > 0 or None
        Frequency of the square wave; a twentieth of the sampling rate by default.
    runs : int >= 1
        Number of simulated runs, each with its own noise.
    rng : int >= 0 or numpy.random.Generator
        Seed of the noise.

    Raises
    ------
    MissingPartError
        If the model lacks circuit, motion or sensor.
    FilterError
        If a sensor has no noise.
    UsageError
        If no run is asked for, or drive and voltage_V are both given.

    Examples
    --------
    >>> import femfit as ff
    >>> sensing = ff.sense("model.json", sensors=("hall",), voltage_V=1.0, runs=2)
    >>> sensing.rms_m.shape == sensing.bound_m.shape
    True
    """
    model = model_of(model)
    if runs < 1 or (drive is not None and voltage_V is not None):
        raise UsageError("sense needs at least one run, and one of drive and voltage_V at most.")
    circuit, sensors = model.require_circuit(), names_or_kinds(model, sensors)
    filter_, random = kalman_filter(model, sensors=sensors), random_generator(rng)
    volts = circuit.voltage_max_V if voltage_V is None else voltage_V
    base = Profile("voltage", np.array([0.0, REST_S, REST_S + ON_S]), np.array([0.0, volts, volts]))
    if drive is not None:
        (base,) = commanded(model, drive, None, None, "held")
    step, end = model.sample_time_s, float(base.time_s[-1])
    command = _with_test(base, circuit, step, test_voltage_V, test_frequency_Hz)
    motion = simulate(model, drive=command, duration_s=end, sample_time_s=step)
    table, process = motion.table, filter_.process
    states = np.zeros((len(table["time_s"]), process.order))
    for k, name in enumerate(("distance_m", "velocity_m_s", "current_A", *model.eddy_names)):
        states[:, k] = table[name]
    held_V = np.r_[table["voltage_V"][:1], table["voltage_V"][:-1]]
    # What is remembered follows from the first states: the body was at rest before
    first = np.linalg.cholesky(process.start_covariance[: process.base, : process.base])
    start = states[0, : process.base] + random.standard_normal((runs, process.base)) @ first.T
    start[:, 0] = np.clip(start[:, 0], *model.require_motion().ends)
    outputs = [sensor_named(model, output.name) for output in process.outputs]
    exact = np.stack([sampled_readings(model, sensor, states[:, : model.order]) for sensor in outputs], axis=1)
    deviation = np.sqrt([output.variance for output in process.outputs])
    periods = np.array([output.period for output in process.outputs])
    state = filter_.start(start)
    rms, claimed = np.empty(len(states)), np.empty(len(states))
    for k, truth in enumerate(states):
        state = state if k == 0 else filter_.predict(state, np.full(runs, held_V[k]))
        readings = exact[k] + deviation * random.standard_normal((runs, len(outputs)))
        readings[:, k % periods > 0] = np.nan
        state = filter_.update(state, readings)
        rms[k] = np.sqrt(np.mean((state.mean[:, 0] - truth[0]) ** 2))
        claimed[k] = np.sqrt(np.mean(state.covariance[:, 0, 0]))
    free = replace(process, model=without_stops(model))
    bound = np.sqrt(bound_along(free, states, held_V)[:, 0, 0])
    return Sensing(motion, sensors, runs, table["time_s"], table["distance_m"], rms, claimed, bound)


def _with_test(base: Profile, circuit: Circuit, step: float, amplitude: float, frequency: float | None) -> Profile:
    """The command, held over each sample, with a square wave on top, as far as the driver goes."""
    frequency = 1.0 / (TEST_SAMPLES * step) if frequency is None else frequency
    if not 0.0 < frequency <= 0.5 / step:
        raise FilterError(
            f"The test voltage's frequency must be > 0 and at most half of the sampling rate, {0.5 / step:g} Hz; "
            f"instead received {frequency:g} Hz."
        )
    if not amplitude:
        return base
    row = np.arange(int(np.ceil(base.time_s[-1] / step)))
    period = max(2, round(1.0 / (frequency * step)))
    sign = np.where(2 * (row % period) < period, 1.0, -1.0)
    low = circuit.voltage_min_V if circuit.drive.diode_V is None else 0.0
    level = np.array([base.at(time) for time in step * (row + 0.5)])
    volts = np.clip(level + amplitude * sign, low, circuit.voltage_max_V)
    return Profile("voltage", np.append(step * row, base.time_s[-1]), np.append(volts, volts[-1]))
