"""Where the body is at rest, without a command and under one, and the linear model around it.

At rest F(d, i) = F_0(d), the weight with springs and load, and U_k = R_k i_k. Around that point, with
x = (distance, velocity, i_1 .. i_n) and the viscous friction c,

    x' = A x + B u,    A = [[0, 1, 0], [-S/m, -c/m, -k_m^T/m], [0, L^-1 k_m, -L^-1 R]],    B = [[0], [0], [L^-1]],

as the equations of motion say it, with what effects make of circuit, driver and friction; eddy currents left aside.
S = F_d - F_0' < 0 makes the point unstable: the mechanical pole without back-EMF and friction is sqrt(-S/m).

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 5.1.
C. F. Van Loan, IEEE Trans. Automat. Contr. 23 (1978) 395, for the matrix exponential of (A, B).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import brentq

from femfit.core.errors import DomainError, MissingPartError
from femfit.core.numerics import FloatArray
from femfit.estimate.holding import holding_currents
from femfit.model.actuator_model import ActuatorModel
from femfit.model.drive import command_limits, commands_currents, held_limits
from femfit.model.dynamics import evaluated, state_scale, voltages_needed
from femfit.model.hall import PickupSensor
from femfit.model.sensors import reading_of, sampled_value, sensors_of
from femfit.simulation.constants import USABLE_PART


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """A point of rest and its linear model."""

    data = "distance_m", "currents_A", "commands", "unstable_pole_rad_s", "coil_pole_rad_s"

    distance_m: float
    currents_A: FloatArray  # Of all circuits, shape (n,)
    commands: FloatArray  # What the drivers are told to hold it: V, or A for a current amplifier; shape (n,)
    # Change of the commands that raises the force with the least copper loss; its largest entry is 1; shape (n,)
    direction: FloatArray
    unstable_pole_rad_s: float  # At constant current, sqrt(-S/m) where the point is unstable, 0 where it is stable
    runaway_rad_s: float  # Fastest growth under constant commands: back-EMF slows a body behind a voltage; 0 if stable
    natural_rad_s: float  # sqrt(|S|/m)
    coil_pole_rad_s: float  # Of the slowest circuit
    inductance_H: float  # Of the first circuit
    # x' = A x + B u with x in (m, m/s, A ..) and u in V; shapes (2 + n, 2 + n) and (2 + n, n)
    A: FloatArray
    B: FloatArray

    @property
    def state(self) -> FloatArray:
        """Distance, velocity and currents at rest, shape (2 + n,)."""
        return np.concatenate([[self.distance_m, 0.0], self.currents_A])


def operating_point(model: ActuatorModel, distance: float) -> OperatingPoint:
    """The point of rest at a distance."""
    currents = holding_currents(model, distance)
    commands = resting_command(model, currents)
    for circuit, command in zip(model.circuits, commands, strict=True):
        amplifier = circuit.drive.kind == "current"
        low, high = held_limits(circuit) if amplifier else command_limits(circuit)
        if not low <= command <= high:
            what, unit = ("current", "A") if amplifier else ("voltage", "V")
            raise DomainError(
                f"The driver must hold {1e3 * model.require_motion().mass_kg:g} g at {1e3 * distance:g} mm with a "
                f"{what} of {low:g}..{high:g} {unit}; model {model.name!r} needs {command:.4g} {unit} there. Choose "
                "another reference distance, or change the body's mass or the supply in the actuator file."
            )
    still, n = model.without_eddies, len(currents)
    all_driven, states = tuple(range(n)), np.zeros((3, still.order))
    states[:, 0], states[:, 2 : 2 + n] = distance, currents
    states[:, 1] = [0.0, -state_scale(model)[1], state_scale(model)[1]]
    slope = evaluated(still, still.equations.flow(all_driven, slope=True), states[0]).reshape(still.order + n, -1).T
    needed = slope[still.order :]
    inverse = np.linalg.inv(needed[:, still.order :])
    A = np.vstack([np.eye(2 + n)[1], slope[1, : 2 + n], -inverse @ needed[:, : 2 + n]])
    B = np.vstack([np.zeros((2, n)), inverse])
    # Friction that is dry brakes a body in motion by less than its slope at rest
    _, slower, faster = evaluated(still, still.equations.flow(all_driven), states)[:, 1]
    A[1, 1] = (faster - slower) / (2.0 * states[2, 1])
    along = -A[1, 2:] / model.resistances_ohm  # the least copper loss for a force
    along = np.where(commands_currents(model), along, needed[:, 2 : 2 + n] @ along)
    constant = float(np.sqrt(max(A[1, 0], 0.0)))
    growing = constant if np.all(commands_currents(model)) else max(float(np.linalg.eigvals(A).real.max()), 0.0)
    return OperatingPoint(
        distance_m=distance,
        currents_A=currents,
        commands=commands,
        direction=along / np.abs(along).max(),
        unstable_pole_rad_s=constant,
        runaway_rad_s=growing,
        natural_rad_s=float(np.sqrt(abs(A[1, 0]))),
        coil_pole_rad_s=float(np.min(np.linalg.eigvals(-A[2:, 2:]).real)),
        inductance_H=float(needed[0, still.order]),
        A=A,
        B=B,
    )


def resting_command(model: ActuatorModel, currents: FloatArray) -> FloatArray:
    """Commands that hold currents of shape (..., n): voltages, or the currents themselves for an amplifier."""
    middle = np.full(np.shape(currents)[:-1], 0.5 * (model.validity.distance_min_m + model.validity.distance_max_m))
    volts = voltages_needed(model, middle, np.zeros_like(middle), currents)[0]
    return np.where(commands_currents(model), currents, volts)


def usable_coil_pole(model: ActuatorModel, point: OperatingPoint) -> float:
    """The coil's pole that a controller may count on: its own, but slow enough for the samples.

    An air coil's R/L is beyond what a sampled loop can use: gains made for it would act within one sample. Behind a
    current amplifier it is the amplifier's bandwidth.
    """
    usable = USABLE_PART / model.sample_time_s
    poles = [
        point.coil_pole_rad_s if circuit.drive.kind == "voltage" else 2 * np.pi * (circuit.drive.bandwidth_Hz or np.inf)
        for circuit in model.circuits
    ]
    return float(min(*poles, usable))


def zero_order_hold(A: FloatArray, B: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Discretise x' = A x + B u with u held: exp of [[A, B], [0, 0]].

    Parameters
    ----------
    B : array, shape (n,) or (n, inputs)
    """
    n, columns = len(B), B.reshape(len(B), -1)
    M = np.zeros((n + columns.shape[1],) * 2)
    M[:n, :n], M[:n, n:] = A * step, columns * step
    result = expm(M)
    return result[:n, :n], result[:n, n:].reshape(B.shape)


def solve_riccati(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray) -> FloatArray:
    """The stabilising solution X, of shape (n, n).

    Parameters
    ----------
    A, B, Q, R : array, shapes (n, n), (n, m), (n, n), (m, m)
        Q is positive semidefinite, R positive definite.

    Raises
    ------
    DomainError
        If there is none: an unstable state cannot be moved, or is not weighed.
    """
    # States of about equal weight, so that metres and volts do not hide each other
    scale = 1.0 / np.sqrt(np.maximum(np.diag(Q), 1e-12 * float(np.diag(Q).max())))
    a, b, q = A * scale / scale[:, None], B / scale[:, None], Q * scale * scale[:, None]
    try:
        solution = solve_discrete_are(a, b, q, R)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise DomainError(
            "The Riccati equation must have a stabilising solution; a state that grows cannot be moved by the drivers "
            "or is not weighed. Choose another point of rest, or other sensors."
        ) from error
    return np.asarray(solution / scale / scale[:, None])


PLACES = 401
"""Conventional: places of the travel between which a change of sign of the force is looked for."""

ROUNDING = 1e-9
"""Numerical: part of the largest force by which forces that balance may miss zero."""


def rest_distance(model: ActuatorModel) -> float:
    """The far stop if the body is pressed to it, else a stable equilibrium, else the near stop.

    Of several equilibria the one that is farthest away. Where there is neither a stop nor an equilibrium, the model's
    first reference distance, or the middle of its validity domain.
    """
    motion, box = model.require_motion(), model.validity
    near, far = motion.near_stop, motion.far_stop
    low = box.distance_min_m if near is None else near.distance_m
    high = box.distance_max_m if far is None else far.distance_m

    def acting(distance: ArrayLike) -> tuple[FloatArray, FloatArray]:
        places_m = np.asarray(distance, dtype=np.float64)
        idle = np.zeros((*places_m.shape, len(model.circuits)))
        return motion.static_force(places_m), -model.magnetics.state(places_m, idle).force

    places = np.linspace(low, high, PLACES)
    static, magnetic = acting(places)
    forces = static + magnetic
    rounding = ROUNDING * float((np.abs(static) + np.abs(magnetic)).max())
    if far is not None and forces[-1] >= -motion.coulomb_N - rounding:
        return far.distance_m
    stable = np.flatnonzero((forces[:-1] > 0.0) & (forces[1:] <= 0.0))
    if len(stable):
        return float(brentq(lambda place: float(sum(acting(place))), places[stable[-1]], places[stable[-1] + 1]))
    stops = [stop.distance_m for stop in (near, far) if stop is not None]
    return next(iter([*stops, *model.reference_distances_m]), 0.5 * (box.distance_min_m + box.distance_max_m))


def sensor_columns(
    model: ActuatorModel, time: FloatArray, states: FloatArray, notes: list[str]
) -> dict[str, FloatArray]:
    """Readings by their columns, cut to their range and as late as drawn; before the first of them, that one.

    A pickup coil reads the mean over the step before. A sensor without a column of a record is left out, such as one of
    two position sensors in volts.

    Parameters
    ----------
    time : array, shape (steps,)
        In s.
    states : array, shape (steps, n)
        As in :mod:`femfit.model.dynamics`.
    notes : list of str
        Takes why the readings of some sensors are not known.
    """
    columns = {}
    for name, sensor in sensors_of(model).items():
        reading = reading_of(model, name)
        if reading.column is None:
            continue
        try:
            values = sampled_value(model, sensor, states, time)
        except MissingPartError as error:
            notes.append(str(error))
            continue
        if isinstance(sensor, PickupSensor):
            steps = np.diff(time)
            values = np.concatenate([[0.0], np.diff(values) / np.where(steps > 0.0, steps, np.inf)])
        late = np.interp(time - reading.delay_s, time, values)
        columns[reading.column] = np.clip(late, reading.low, reading.high)
    return columns
