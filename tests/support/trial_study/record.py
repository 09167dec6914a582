"""Closed-loop records of a levitated body: the loop of femfit.simulation round a body that moves otherwise.

The controller follows steps of the distance, with a small random square wave on its voltage that moves what a smooth
reference would leave at rest. Distance, current and Hall voltage are recorded by meters of their own.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from femfit.core.arrays import FloatArray
from femfit.core.errors import DomainError
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.constants import SUPPORT_TIME_CONSTANTS
from femfit.simulation.design import LoopDesign, design_loop
from femfit.simulation.operating_point import operating_point
from femfit.simulation.reference import Reference, reference_steps
from support.trial_study.levitated_body import MovingTruth

_DITHER = 0.04
"""Of the driver's span."""


@dataclass(frozen=True)
class Recorder:
    """How a record is taken.

    Parameters
    ----------
    sigma : mapping of str to float
        White noise of ``distance_m``, ``current_A`` and ``hall_V``; those channels are recorded.
    """

    runs: int
    samples: int
    sigma: Mapping[str, float]
    targets_m: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Trajectory:
    """What really happened, every array of shape (samples, runs, ...).

    Parameters
    ----------
    state : array, shape (samples, runs, 8)
        Of :class:`support.trial_study.levitated_body.MovingTruth`.
    voltage : array, shape (samples, runs)
        Commanded and held until the next sample.
    hall : array, shape (samples, runs)
        The element's output without noise.
    """

    state: FloatArray
    voltage: FloatArray
    hall: FloatArray


def closed_loop(
    plant: MovingTruth, model: ActuatorModel, recorder: Recorder, generator: np.random.Generator
) -> Trajectory:
    """Hold a body by the controller that the model would have designed.

    Parameters
    ----------
    model : ActuatorModel
        Of the drawing: what controller and filter believe.

    Raises
    ------
    DomainError
        If the body was lost: it left the swept distances.
    """
    design = design_loop(model)
    step, runs = model.sample_time_s, recorder.runs
    reference = _references(design, recorder, step)
    controller, observer = design.controller("pid"), design.observer("ukf4")
    first = recorder.targets_m[0]
    current = operating_point(model, first).current_A
    state = plant.start(np.full(runs, first), np.full(runs, current))
    belief = state[:, :3]
    memory, seen = np.zeros((runs, controller.words)), observer.start(belief)
    circuit = model.require_circuit()
    low, high = circuit.voltage_min_V, circuit.voltage_max_V
    voltage = np.clip(np.full(runs, circuit.resistance_ohm * current), low, high)
    states = np.empty((recorder.samples, *state.shape))
    voltages, halls = np.empty((recorder.samples, runs)), np.empty((recorder.samples, runs))
    dither = np.zeros(runs)
    for k in range(design.steps(SUPPORT_TIME_CONSTANTS)):  # the body rests on a support until the filter has settled
        reading = plant.hall_output(state) + design.noise["hall"] * generator.standard_normal(runs)
        seen = observer.step(seen, voltage, reading) if k else observer.update(seen, reading)
    for k in range(recorder.samples):
        output = plant.hall_output(state)
        reading = output + design.noise["hall"] * generator.standard_normal(runs)
        seen = observer.step(seen, voltage, reading)
        command, memory = controller.command(memory, seen.mean[:, :3], reference.at(k))
        flips = generator.random(runs) < 0.05
        dither = np.where(flips | (k == 0), _DITHER * (high - low) * generator.choice([-1.0, 1.0], runs), dither)
        voltage = np.clip(command[:, 0] + dither, low, high)
        states[k], voltages[k], halls[k] = state, voltage, output
        state = plant.step(state, voltage, step)
        inside = (state[:, 0] > model.validity.distance_min_m) & (state[:, 0] < model.validity.distance_max_m)
        if not inside.all():
            raise DomainError(
                f"The body must stay within the swept distances; it was lost after {k * step:.3g} s. Hide less."
            )
    return Trajectory(states, voltages, halls)


def record(
    trajectory: Trajectory, model: ActuatorModel, recorder: Recorder, generator: np.random.Generator
) -> pd.DataFrame:
    """What the meters write of a trajectory.

    Parameters
    ----------
    model : ActuatorModel
        For the sample period and the Hall element's converter.

    Returns
    -------
    DataFrame
        The contract's time series, run by run.
    """
    samples, runs = trajectory.voltage.shape
    truth = {
        "distance_m": trajectory.state[:, :, 0],
        "current_A": trajectory.state[:, :, 2],
        "hall_V": trajectory.hall,
    }
    columns: dict[str, FloatArray] = {
        "run": np.repeat(np.arange(runs) + 1.0, samples),
        "time_s": np.tile(model.sample_time_s * np.arange(samples), runs),
        "voltage_V": trajectory.voltage.T.ravel(),
    }
    for name, sigma in recorder.sigma.items():
        values = truth[name] + sigma * generator.standard_normal(truth[name].shape)
        span = 1.3 * float(np.abs(truth[name]).max())
        sensor = model.sensor
        lsb = sensor.quantisation_step if name == "hall_V" and sensor else span / 2.0**14
        columns[name] = (np.round(values / lsb) * lsb).T.ravel()
    return pd.DataFrame(columns)


def window_change(
    plain: MovingTruth, changed: MovingTruth, trajectory: Trajectory, time_s: float, samples: int = 40
) -> dict[str, FloatArray]:
    """What an effect does within short windows, from the same starts and under the same voltages.

    Returns
    -------
    dict of str to array
        Changes of ``distance_m``, ``current_A`` and ``hall_V`` at the windows' samples.
    """
    starts = np.arange(0, len(trajectory.voltage) - samples, samples)
    here = trajectory.state[starts].reshape(-1, trajectory.state.shape[2])
    pushes = np.stack([trajectory.voltage[starts + k].ravel() for k in range(samples)])
    states = [here, changed.warmed(here)]
    result: dict[str, list[FloatArray]] = {"distance_m": [], "current_A": [], "hall_V": []}
    for push in pushes:
        states = [plant.step(state, push, time_s) for plant, state in zip((plain, changed), states, strict=True)]
        difference = states[1] - states[0]
        result["distance_m"].append(difference[:, 0])
        result["current_A"].append(difference[:, 2])
        result["hall_V"].append(changed.hall_output(states[1]) - plain.hall_output(states[0]))
    return {name: np.concatenate(parts) for name, parts in result.items()}


def _references(design: LoopDesign, recorder: Recorder, step: float) -> Reference:
    return reference_steps(recorder.targets_m, recorder.samples, step, design.reference_rate_rad_s)
