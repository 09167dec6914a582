"""Heat in balance: what feeds the circuits, where a network settles, how it gets there, and what current may last.

C dT/dt = -L T + g T_a + q + P (1 + alpha (T - 20 degC)), P each winding's heat at 20 degC. At held currents that is
linear: it settles where L - alpha diag(P) is positive definite, and runs away beyond.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.optimize import brentq

from femfit.core.errors import MissingPartError, UsageError
from femfit.core.numerics import COPPER_TEMPERATURE_COEFFICIENT, FloatArray
from femfit.device.parts import REFERENCE_TEMPERATURE, Actuator, copper_growth
from femfit.device.thermal import Surroundings
from femfit.heat.network import HeatNetwork

Powers = Callable[[FloatArray], FloatArray]
"""Heat of each part in W at their temperatures in degC, shape (n,)."""

HORIZON = 30.0
"""Numerical: of the slowest time constant, after which a network is taken as settled: 1e-13 is left."""


def settled(network: HeatNetwork, ambient: float, cold_W: FloatArray) -> FloatArray:
    """Temperatures in degC at held currents, shape (n,); NaN where they grow until something gives way.

    ``cold_W`` is each winding's heat at 20 degC, zero where a part is no winding, shape (n,).
    """
    rising = COPPER_TEMPERATURE_COEFFICIENT * cold_W
    matrix = network.laplacian - np.diag(rising)
    if not np.linalg.eigvalsh(matrix)[0] > 0.0:
        return np.full(len(matrix), np.nan)
    constant = cold_W - rising * REFERENCE_TEMPERATURE
    return np.asarray(np.linalg.solve(matrix, network.outwards * ambient + constant))


def largest_factor(network: HeatNetwork, cold_W: FloatArray) -> float:
    """What the windings' heat may be multiplied by at most to settle at all; infinite where none is heated."""
    rising = np.diag(COPPER_TEMPERATURE_COEFFICIENT * cold_W)
    largest = np.linalg.eigvals(np.linalg.solve(network.laplacian, rising)).real.max(initial=0.0)
    return float(1.0 / largest) if largest > 0.0 else np.inf


def time_until(
    network: HeatNetwork, ambient: float, powers: Powers, reached: Callable[[FloatArray], float]
) -> float | None:
    """Time in s from switching on, everything at ambient, to where ``reached`` becomes positive; None where never."""

    def slope(_: float, temperatures: FloatArray) -> FloatArray:
        heat = powers(temperatures) + network.outwards * ambient - network.laplacian @ temperatures
        return np.asarray(heat / network.capacities)

    def crossing(_: float, temperatures: FloatArray) -> float:
        return reached(temperatures)

    crossing.terminal, crossing.direction = True, 1.0  # type: ignore[attr-defined]  # as solve_ivp wants
    start = np.full(len(network.capacities), ambient)
    if reached(start) >= 0.0:
        return 0.0
    slowest_s = 1.0 / eigh(network.laplacian, np.diag(network.capacities), eigvals_only=True)[0]
    course = solve_ivp(slope, (0.0, HORIZON * slowest_s), start, "LSODA", events=crossing, rtol=1e-8, atol=1e-6)
    (times,) = course.t_events or [np.zeros(0)]
    return float(times[0]) if len(times) else None


ROUNDS, CLOSE_K = 500, 1e-9
"""Numerical: of the iteration at held voltages, which halves its error in each round or does better where no current is
held beside them."""

LARGEST = 1e9
"""Numerical: of a current or a voltage, whose heat is a number still."""

LOST_C = 1e5
"""Numerical: temperature at which a winding is taken to run away."""


@dataclass(frozen=True, eq=False)
class Feed:
    """Circuits (n,) with their windings (k,), in the order of a network's first nodes."""

    volts: FloatArray  # NaN where a current is held
    amperes: FloatArray  # NaN where a voltage is held
    external_ohm: FloatArray  # In series with the windings, at ambient
    cold_ohm: FloatArray  # Of each winding at 20 degC, shape (k,)
    circuit: FloatArray  # One where a winding is in a circuit, shape (n, k)

    def resistances(self, temperatures: FloatArray) -> FloatArray:
        """Of the circuits in ohm, at the temperatures of all parts."""
        windings = self.cold_ohm * copper_growth(temperatures[: len(self.cold_ohm)])
        return np.asarray(self.external_ohm + self.circuit @ windings)

    def currents(self, temperatures: FloatArray) -> FloatArray:
        """Currents in A."""
        return np.where(np.isnan(self.volts), self.amperes, self.volts / self.resistances(temperatures))

    def cold_W(self, currents: FloatArray, parts: int) -> FloatArray:  # noqa: N802  the unit
        """Heat of each part at currents, the windings at 20 degC."""
        return np.pad(self.cold_ohm * (currents**2 @ self.circuit), (0, parts - len(self.cold_ohm)))

    def powers(self, temperatures: FloatArray) -> FloatArray:
        """Heat of each part in W at its temperature."""
        cold = self.cold_W(self.currents(temperatures), len(temperatures))
        return np.asarray(cold * copper_growth(temperatures))

    def settled(self, network: HeatNetwork, ambient: float) -> FloatArray:
        """Temperatures that last, shape (parts,); NaN where there are none."""
        temperatures = np.full(len(network.names), ambient)
        if np.isnan(self.volts).all():
            return settled(network, ambient, self.cold_W(self.amperes, len(temperatures)))
        for _ in range(ROUNDS):
            following = np.linalg.solve(network.laplacian, self.powers(temperatures) + network.outwards * ambient)
            if np.abs(following - temperatures).max() < CLOSE_K:
                return np.asarray(following)
            temperatures = 0.5 * (temperatures + following)  # at a held voltage more heat comes of less warmth
            if temperatures.max() > LOST_C:
                break
        return np.full(len(temperatures), np.nan)


def feed_of(
    actuator: Actuator,
    network: HeatNetwork,
    voltage_V: float | Sequence[float] | None,
    current_A: float | Sequence[float] | None,
) -> Feed:
    """Feed every circuit with what is given, or else with the most that its supply gives."""
    circuits = actuator.circuits
    if not circuits:
        raise MissingPartError(f"Actuator {actuator.name!r} must have a coil for this; it has none.")
    if voltage_V is not None and current_A is not None:
        raise UsageError("Give either a voltage or a current; both were given.")
    count = len(circuits)
    volts, amperes = np.full((2, count), np.nan)
    for name, value, held in (("voltage_V", voltage_V, volts), ("current_A", current_A, amperes)):
        if value is not None:
            values = np.asarray(value, dtype=np.float64).reshape(-1)
            if len(values) not in {1, count} or not (np.abs(values) <= LARGEST).all():
                raise UsageError(
                    f"{name} must be one number up to {LARGEST:.0e}, or one for each of {count} circuits; got {value}."
                )
            held[:] = values
    if voltage_V is None and current_A is None:
        for k, circuit in enumerate(circuits):
            drive, held, ends = circuit.drive, volts, (circuit.voltage_min_V, circuit.voltage_max_V)
            if drive.kind == "current" and drive.current_min_A is not None and drive.current_max_A is not None:
                held, ends = amperes, (drive.current_min_A, drive.current_max_A)
            held[k] = max(ends, key=lambda end: (abs(end), end))
        if np.isinf(volts).any():
            raise UsageError("The drawing's supply has no limits; give a voltage or a current.")
    coils = actuator.coils
    member = np.array([[float(coil.circuit == circuit.name) for coil in coils] for circuit in circuits])
    drawn = np.array([circuit.resistance_ohm for circuit in circuits])
    external = drawn - member @ [coil.resistance_ohm for coil in coils]
    cold = np.array([winding.cold_ohm for winding in network.windings])
    return Feed(volts, amperes, np.maximum(external, 0.0), cold, member)


def hottest(network: HeatNetwork, ambient: float, temperatures: FloatArray) -> FloatArray:
    """Temperature near that of the hottest strand of each winding in degC, shape (windings,).

    It is taken to be as far over the mean as the network's mean is over the faces: in a slab it is half as far, in a
    square 0.92.
    """
    inside = network.inside @ np.append(temperatures, ambient)
    return np.asarray(temperatures[: len(network.windings)] + np.maximum(inside, 0.0))


def largest_heat(network: HeatNetwork, around: Surroundings, cold_W: FloatArray) -> tuple[float, str]:
    """Factor of the windings' heat that brings a part to its limit, infinite where none can, and that part's name."""
    count = len(network.windings)
    limits_C = [region.material.thermal.working_temperature_C for region in network.regions]
    limits = np.array([around.winding_limit_C] * count + [np.inf if limit is None else limit for limit in limits_C])

    def over(factor: float) -> FloatArray:
        temperatures = settled(network, around.ambient_C, factor * cold_W)
        if np.isnan(temperatures).any():
            return np.where(np.isfinite(limits), np.inf, -np.inf)
        temperatures[:count] = hottest(network, around.ambient_C, temperatures)
        return np.asarray(temperatures - limits)

    if over(0.0).max() >= 0.0:
        return 0.0, network.names[int(over(0.0).argmax())]
    high = largest_factor(network, cold_W)
    if not np.isfinite(high):
        return np.inf, ""
    factor = float(brentq(lambda trial: over(trial).max(), 0.0, high * (1.0 - 1e-9), rtol=1e-12))
    return factor, network.names[int(over(factor).argmax())]
