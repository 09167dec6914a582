"""The sampled loop about a point of rest: plant with its drivers and delays, observer and controller, all linear.

    plant       x(k+1) = A x(k) + B u(k - q),              y_j(k) = sum over m of c_jm x(k - m)
    observer    x^(k) = P x^(k-1) + G u(k - 1 - q) + L y(k)
    controller  m(k+1) = M m(k) + E x^(k),                 u(k) = N m(k) + D x^(k)

u is the change of the commands. The matrices of plant, direct measurement and controller are differences of the very
functions that the simulation steps; those of a Kalman filter follow from its Jacobians and its settled covariance.

References
----------
K. J. Astrom and B. Wittenmark, Computer-Controlled Systems (Prentice Hall, 1997), chapters 3 and 4.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from femfit.core.numerics import ComplexArray, FloatArray, central_differences
from femfit.estimate.filter import Filter
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import commands_currents
from femfit.model.dynamics import state_scale
from femfit.model.sensors import sample_weights, sampled_value, sensor_named
from femfit.simulation.allocation import limits_of
from femfit.simulation.controllers import Controller
from femfit.simulation.observers import DirectObserver
from femfit.simulation.operating_point import OperatingPoint, solve_riccati
from femfit.simulation.plant import LoopSensor, Plant
from femfit.simulation.targets import Reference


@dataclass(frozen=True, eq=False)
class LinearPlant:
    """Plant and sensors at a point of rest."""

    A: FloatArray  # (N, N)
    B: FloatArray  # (N, n)
    C: FloatArray  # What each sensor reads of the state now, one sample ago and so on, (sensors, samples, N)
    noise: FloatArray  # Standard deviation of each reading, (sensors,)

    def response(self, z: ComplexArray, latency: int = 0) -> ComplexArray:
        """Readings over commands that are applied so many samples late, of shape (frequencies, sensors, n)."""
        states = np.linalg.solve(z[:, None, None] * np.eye(len(self.A)) - self.A, self.B + 0j)
        readings = np.einsum("fm,jmx->fjx", z[:, None] ** -np.arange(self.C.shape[1]), self.C)
        return np.asarray(readings @ states * z[:, None, None] ** -latency)


@dataclass(frozen=True, eq=False)
class LinearController:
    """Observer and controller of the module's head."""

    P: FloatArray
    G: FloatArray
    L: FloatArray
    M: FloatArray
    E: FloatArray
    N: FloatArray
    D: FloatArray
    latency: int  # Samples from a command to its effect

    def response(self, z: ComplexArray) -> ComplexArray:
        """Commands over readings, of shape (frequencies, n, sensors).

        Of the commands on their way only the oldest acts, so that u = W (G z^-(latency + 1) u + L y) with
        W = (D + N (z - M)^-1 E) (1 - P/z)^-1.
        """
        each, n = z[:, None, None], len(self.D)
        inputs = np.concatenate([self.G * each ** -(self.latency + 1), self.L + 0j * each], axis=2)
        estimate = np.linalg.solve(np.eye(len(self.P)) - self.P / each, inputs)
        words = np.linalg.solve(each * np.eye(len(self.M)) - self.M, self.E + 0j)
        both = (self.D + self.N @ words) @ estimate
        return np.asarray(np.linalg.solve(np.eye(n) - both[..., :n], both[..., n:]))


def closed_loop_matrix(plant: LinearPlant, controller: LinearController) -> FloatArray:
    """The state matrix of the whole loop; its eigenvalues are the loop's poles.

    Its states are those of the plant, what earlier ones add to each sensor's next readings, the estimate, the
    controller's memory, and the commands given before, the last one first.
    """
    (order, n), (sensors, samples, _), k = plant.B.shape, plant.C.shape, controller
    late, pending = samples - 1, n * (k.latency + 1)
    sizes = [order, sensors * late, len(k.P), len(k.M), pending]
    x, chains, estimate, memory, before = np.split(np.eye(sum(sizes)), np.cumsum(sizes)[:-1])
    chains = chains.reshape(sensors, late, sum(sizes))
    later = np.zeros_like(chains)
    later[:, :-1] = chains[:, 1:]
    readings = plant.C[:, 0] @ x + chains[:, :1].sum(axis=1)
    estimate = k.P @ estimate + k.G @ before[-n:] + k.L @ readings
    commands = np.concatenate([k.N @ memory + k.D @ estimate, before])
    acting = commands[n * k.latency :][:n]
    moved = plant.A @ x + plant.B @ acting
    later += plant.C[:, 1:] @ x
    memory = k.M @ memory + k.E @ estimate
    return np.concatenate([moved, later.reshape(sizes[1], sum(sizes)), estimate, memory, commands[:pending]])


Linear: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""P, G and L of the module's head."""


@dataclass(frozen=True, eq=False)
class Rest:
    """A point of rest, linear."""

    model: ActuatorModel
    point: OperatingPoint
    plant: LinearPlant
    observer: Linear
    room: FloatArray  # From the resting commands to the nearer limits, in the commands' units, shape (n,)

    @classmethod
    def at(
        cls,
        model: ActuatorModel,
        point: OperatingPoint,
        sensors: Sequence[LoopSensor],
        observer: Filter | DirectObserver | None,
    ) -> "Rest":
        """A point with its sensors and observer; without one every state is known at once, without noise."""
        plant, order, (low, high) = linear_plant(model, point, sensors), model.order, limits_of(model)
        room = np.minimum(point.commands - low, high - point.commands)
        if observer is None:
            plant = replace(plant, C=np.eye(order)[:, None], noise=np.zeros(order))
            linear = np.zeros((order, order)), np.zeros((order, len(point.commands))), np.eye(order)
        elif isinstance(observer, DirectObserver):
            linear = _linear_direct(model, point, observer)
        else:
            linear = _linear_filter(model, point, observer)
        return cls(model, point, plant, linear, room)

    def closed_by(self, controller: Controller, latency: int) -> LinearController:
        """The observer with a controller behind it."""
        point, n, estimated = self.point, len(self.point.commands), len(self.observer[0])
        states, still = 2 + n, np.zeros(1)
        reference = Reference(np.array([point.distance_m]), still, still, point.currents_A[None])
        rest, scale = np.zeros(states + controller.words), np.full(states + controller.words, 1e-2)
        rest[:states], scale[:states] = point.state, state_scale(self.model)[:states]
        (slopes,) = central_differences(
            lambda both: np.concatenate(controller.command(both[:, states:], both[:, :states], reference), axis=1),
            rest[None],
            scale,
        )
        by_estimate = np.pad(slopes[:, :states], ((0, 0), (0, estimated - states)))
        law = slopes[n:, states:], by_estimate[n:], slopes[:n, states:], by_estimate[:n]
        return LinearController(*self.observer, *law, latency)


def linear_plant(model: ActuatorModel, point: OperatingPoint, sensors: Sequence[LoopSensor]) -> LinearPlant:
    """Differences of one step of the plant, and of its readings."""
    plant = Plant(model)
    rest = plant.start(point.state[None])[0]
    scale, push = state_scale(model), _command_scale(model, point)

    def step(both: FloatArray) -> FloatArray:
        return plant.step(both[:, : len(rest)], both[:, len(rest) :])

    start = np.concatenate([rest, point.commands])
    (both,) = central_differences(step, start[None], np.concatenate([scale, push]))
    slopes = []
    for sensor in sensors:
        # Of p samples one is read: what is seen is (p - 1)/2 samples old on average
        late = sensor.reading.delay_s + 0.5 * (sensor.period - 1) * model.sample_time_s
        weights = sample_weights(replace(sensor.sensor, delay_s=late), model.sample_time_s)
        slope = central_differences(partial(sampled_value, model, sensor.sensor), rest[None], scale)
        slopes.append(np.outer(weights, slope[0]))
    C = np.zeros((len(sensors), max(map(len, slopes), default=1), len(rest)))
    for j, rows in enumerate(slopes):
        C[j, : len(rows)] = rows
    # As in a filter's R: noise that is met once in p samples tells as little as sqrt(p) times as much at each
    noise = np.array([sensor.reading.white * np.sqrt(sensor.period) for sensor in sensors])
    return LinearPlant(both[:, : len(rest)], both[:, len(rest) :], C, noise)


def _command_scale(model: ActuatorModel, point: OperatingPoint) -> FloatArray:
    widths = state_scale(model)[2 : 2 + len(point.commands)]
    return np.where(commands_currents(model), widths, widths * model.resistances_ohm)


def _linear_filter(model: ActuatorModel, point: OperatingPoint, observer: Filter) -> Linear:
    """From a filter's Jacobians and its settled covariance."""
    process = observer.process
    rest = np.concatenate([point.state, np.zeros(process.order - len(point.state))])
    A = process.with_slopes(rest[None], point.commands[None])[1][0]
    (B,) = central_differences(
        lambda inputs: process.transition(np.tile(rest, (len(inputs), 1)), inputs),
        point.commands[None],
        _command_scale(model, point),
    )
    C = np.stack([process.gradient(output.name, rest[None])[0] for output in process.outputs])
    # As in the bound: a sensor that is read at every p-th sample tells as much as one of p times the variance
    R = np.diag([output.variance * output.period for output in process.outputs])
    covariance = solve_riccati(A.T, C.T, process.process_covariance, R)
    gain = np.asarray(np.linalg.solve(C @ covariance @ C.T + R, C @ covariance).T, dtype=np.float64)
    remainder = np.eye(len(A)) - gain @ C
    return remainder @ A, remainder @ B, gain


def _linear_direct(model: ActuatorModel, point: OperatingPoint, observer: DirectObserver) -> Linear:
    """Jacobians of a step of the direct measurement in state, commands and first reading."""
    n, rest = len(point.commands), point.state
    reading = sampled_value(model, sensor_named(model, observer.sensor), Plant(model).start(rest[None]))
    scales = state_scale(model)[: 2 + n], _command_scale(model, point), np.maximum(np.abs(reading), 1e-3)
    (slopes,) = central_differences(
        lambda x: observer.step(observer.start(x[:, : 2 + n]), x[:, 2 + n : -1], x[:, -1:]).mean,
        np.concatenate([rest, point.commands, reading])[None],
        np.concatenate(scales),
    )
    return slopes[:, : 2 + n], slopes[:, 2 + n : -1], slopes[:, -1:]
