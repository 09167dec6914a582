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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from femfit.core.numerics import ComplexArray, FloatArray
from femfit.estimate.filter import Filter
from femfit.model.actuator_model import ActuatorModel
from femfit.model.dynamics import state_scale
from femfit.model.sensors import sample_weights, sampled_value
from femfit.simulation.controllers import Controller
from femfit.simulation.observers import DirectObserver
from femfit.simulation.operating_point import OperatingPoint, solve_riccati
from femfit.simulation.plant import Plant
from femfit.simulation.sensor import LoopSensor
from femfit.simulation.targets import Reference

_PROBE = 1e-5
"""Part of a state's range over which differences are taken."""


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
    """Observer and controller together, from readings y to commands u: s+ = A s + B y, u = C s + D y."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    latency: int  # Samples from a command to its effect; the last entries of s are the commands on their way
    order: int  # Of the plant, all of whose states are the readings where the state is known exactly

    def response(self, z: ComplexArray) -> ComplexArray:
        """Commands over readings, of shape (frequencies, n, sensors).

        Of the commands on their way only the oldest acts, which is the newest so many samples ago: u solves
        u = H z^-(latency + 1) u + K y with the small loop of observer and controller alone.
        """
        n, late = len(self.C), self.latency + 1
        inner, oldest = slice(0, len(self.A) - n * late), slice(len(self.A) - n, None)
        inputs = np.concatenate([self.A[inner, oldest], self.B[inner]], axis=1)
        states = np.linalg.solve(z[:, None, None] * np.eye(len(inputs)) - self.A[inner, inner], inputs + 0j)
        both = self.C[:, inner] @ states + np.concatenate([self.C[:, oldest], self.D], axis=1)
        again = np.eye(n) - both[..., :n] * z[:, None, None] ** -late
        return np.asarray(np.linalg.solve(again, both[..., n:]))


def linear_plant(model: ActuatorModel, point: OperatingPoint, sensors: Sequence[LoopSensor]) -> LinearPlant:
    """Differences of one step of the plant, and of its readings."""
    plant = Plant(model)
    rest = plant.start(point.state[None])[0]
    scale, push = state_scale(model), _command_scale(model, point)

    A, B = _differences(plant.step, rest, point.commands, scale, push)
    slopes = []
    for sensor in sensors:
        # Of p samples one is read: what is seen is (p - 1)/2 samples old on average
        late = (sensor.delay + 0.5 * (sensor.period - 1)) * model.sample_time_s
        weights = sample_weights(replace(sensor.sensor, delay_s=late), model.sample_time_s)
        slopes.append(np.outer(weights, _slope(partial(sampled_value, model, sensor.sensor), rest, scale)))
    C = np.zeros((len(sensors), max(map(len, slopes), default=1), len(rest)))
    for j, rows in enumerate(slopes):
        C[j, : len(rows)] = rows
    # As in a filter's R: noise that is met once in p samples tells as little as sqrt(p) times as much at each
    noise = np.array([sensor.reading.white * np.sqrt(sensor.period) for sensor in sensors])
    return LinearPlant(A, B, C, noise)


def exact_readings(plant: LinearPlant) -> LinearPlant:
    """The plant where every state is known at once, without noise."""
    order = len(plant.A)
    return replace(plant, C=np.eye(order)[:, None], noise=np.zeros(order))


def joined(
    model: ActuatorModel,
    point: OperatingPoint,
    observer: tuple[FloatArray, FloatArray, FloatArray],
    controller: Controller,
    latency: int,
) -> LinearController:
    """A controller behind an observer that is linear already."""
    n = len(point.commands)
    order = model.order
    P, G, L = observer
    M, E, N, D = _controller(model, point, controller, len(P))
    estimated, words, inputs = len(P), len(M), L.shape[1]
    pending = n * (latency + 1)
    size = estimated + words + pending
    A, B = np.zeros((size, size)), np.zeros((size, inputs))
    C, Dy = np.zeros((n, size)), D @ L
    applied = slice(size - n, size)  # the oldest command on its way acted from the sample before to this one
    A[:estimated, :estimated], A[:estimated, applied], B[:estimated] = P, G, L
    rows = slice(estimated, estimated + words)
    A[rows, :estimated], A[rows, rows], A[rows, applied], B[rows] = E @ P, M, E @ G, E @ L
    C[:, :estimated], C[:, rows], C[:, applied] = D @ P, N, D @ G
    first = slice(estimated + words, estimated + words + n)
    A[first], B[first] = C, Dy
    for k in range(latency):
        start = estimated + words + n * (k + 1)
        A[start : start + n, start - n : start] = np.eye(n)
    return LinearController(A, B, C, Dy, latency, order)


def closed_loop_matrix(plant: LinearPlant, controller: LinearController) -> FloatArray:
    """The state matrix of the whole loop; its eigenvalues are the loop's poles."""
    N, n = plant.B.shape
    sensors, samples, _ = plant.C.shape
    late = samples - 1
    inner, size = N + sensors * late, N + sensors * late + len(controller.A)
    y, F = np.zeros((sensors, size)), np.zeros((size, size))
    y[:, :N] = plant.C[:, 0]
    # A sensor's chain holds what earlier states add to its next readings, the next one first
    for j in range(sensors if late else 0):
        chain = np.arange(N + j * late, N + (j + 1) * late)
        y[j, chain[0]] = 1.0
        F[chain[:-1], chain[1:]] = 1.0
        F[chain, :N] = plant.C[j, 1:]
    control = slice(inner, size)
    u = controller.D @ y
    u[:, control] += controller.C
    F[:N, :N] += plant.A
    if controller.latency:  # the command given so many samples ago
        start = size - n * controller.latency - n + n * (controller.latency - 1)
        F[:N, start : start + n] += plant.B
    else:
        F[:N] += plant.B @ u
    F[control] += controller.B @ y
    F[control, control] += controller.A
    return F


def _command_scale(model: ActuatorModel, point: OperatingPoint) -> FloatArray:
    widths = state_scale(model)[2 : 2 + len(point.commands)]
    amplified = [circuit.drive.kind == "current" for circuit in model.circuits]
    return np.where(amplified, widths, widths * model.resistances_ohm)


def _slope(function: Callable[[FloatArray], FloatArray], rest: FloatArray, scale: FloatArray) -> FloatArray:
    """Gradient of a function of states (N, order) -> (N,)."""
    steps = np.diag(_PROBE * scale)
    values = function(np.concatenate([rest + steps, rest - steps]))
    return np.asarray((values[: len(rest)] - values[len(rest) :]) / (2.0 * _PROBE * scale))


def _differences(
    step: Callable[[FloatArray, FloatArray], FloatArray],
    rest: FloatArray,
    commands: FloatArray,
    scale: FloatArray,
    push: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Jacobians of a step in its states, and in its commands or what else it takes."""
    order, n = len(rest), len(commands)
    both = np.concatenate([rest, commands])
    steps = np.diag(_PROBE * np.concatenate([scale, push]))
    points = np.concatenate([both + steps, both - steps])
    moved = step(points[:, :order], points[:, order:])
    slopes = (moved[: order + n] - moved[order + n :]) / (2.0 * _PROBE * np.concatenate([scale, push]))[:, None]
    return slopes[:order].T, slopes[order:].T


def linear_observer(
    model: ActuatorModel, point: OperatingPoint, observer: Filter | DirectObserver | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """P, G and L of the module's head."""
    n, order = len(point.commands), model.order
    if observer is None:
        return np.zeros((order, order)), np.zeros((order, n)), np.eye(order)
    if isinstance(observer, DirectObserver):
        return observer.linear(point)
    A, B, C, R = linear_filter(model, point, observer)
    covariance = solve_riccati(A.T, C.T, observer.process.process_covariance, R)
    gain = np.asarray(np.linalg.solve(C @ covariance @ C.T + R, C @ covariance).T, dtype=np.float64)
    remainder = np.eye(len(A)) - gain @ C
    return remainder @ A, remainder @ B, gain


def linear_filter(
    model: ActuatorModel, point: OperatingPoint, observer: Filter
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Jacobians of a filter's transition in states and commands, of its readings, and their covariance."""
    n, process = len(point.commands), observer.process
    rest = np.concatenate([point.state, np.zeros(process.order - 2 - n)])
    commands = point.commands if n > 1 else point.commands[0]
    A = process.state_jacobian(rest[None], np.array([commands]))[0]
    push = _command_scale(model, point)
    ends = [np.array([(point.commands + sign * _PROBE * push * row) for row in np.eye(n)]) for sign in (1.0, -1.0)]
    moved = [process.transition(np.tile(rest, (n, 1)), end if n > 1 else end[:, 0]) for end in ends]
    B = ((moved[0] - moved[1]) / (2.0 * _PROBE * push)[:, None]).T
    C = np.stack([process.output_jacobian(rest[None], output)[0] for output in process.outputs])
    # As in the bound: a sensor that is read at every p-th sample tells as much as one of p times the variance
    R = np.diag([output.variance * output.period for output in process.outputs])
    return A, B, C, R


def _controller(
    model: ActuatorModel, point: OperatingPoint, controller: Controller, estimated: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """M, E, N and D of the module's head."""
    n, words = len(point.commands), controller.words
    still = np.zeros(1)
    reference = Reference(np.array([point.distance_m]), still, still, point.currents_A[None])

    def step(estimates: FloatArray, memory: FloatArray) -> FloatArray:
        return np.concatenate(controller.command(memory, estimates, reference), axis=1)

    scale, words_scale = state_scale(model)[: 2 + n], np.full(words, 1e-2)
    by_estimate, by_memory = _differences(step, point.state, np.zeros(words), scale, words_scale)
    D, E = np.zeros((n, estimated)), np.zeros((words, estimated))
    D[:, : 2 + n], E[:, : 2 + n] = by_estimate[:n], by_estimate[n:]
    return by_memory[n:], E, by_memory[:n], D
