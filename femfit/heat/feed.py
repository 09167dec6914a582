"""What feeds the circuits while they warm up: held voltages or held currents, and an alternating part."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import MissingPartError, UsageError
from femfit.device.parts import Actuator
from femfit.heat.balance import Loads, settled
from femfit.heat.network import HeatNetwork
from femfit.heat.winding import growth

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
    alternating_A: FloatArray  # Rms value beside it
    external_ohm: FloatArray  # In series with the windings, at ambient
    cold_ohm: FloatArray  # Of each winding at 20 degC, shape (k,)
    circuit: FloatArray  # One where a winding is in a circuit, shape (n, k)
    eddy_W: FloatArray  # By the alternating currents, of each part

    def resistances(self, temperatures: FloatArray) -> FloatArray:
        """Of the circuits in ohm, at the temperatures of all parts."""
        windings = self.cold_ohm * growth(temperatures[: len(self.cold_ohm)])
        return np.asarray(self.external_ohm + self.circuit @ windings)

    def currents(self, temperatures: FloatArray) -> FloatArray:
        """Direct currents in A."""
        return np.where(np.isnan(self.volts), self.amperes, self.volts / self.resistances(temperatures))

    def loads(self, currents: FloatArray) -> Loads:
        """Heat at direct currents."""
        winding = np.zeros(len(self.eddy_W))
        winding[: len(self.cold_ohm)] = self.cold_ohm * ((currents**2 + self.alternating_A**2) @ self.circuit)
        return Loads(winding, self.eddy_W)

    def powers(self, temperatures: FloatArray) -> FloatArray:
        """Heat of each part in W at its temperature."""
        return self.loads(self.currents(temperatures)).at(temperatures)

    def held(self, factor: float, currents: FloatArray) -> "Feed":
        """The direct currents, now held, with all currents multiplied by a factor."""
        none = np.full(len(self.volts), np.nan)
        alternating, eddy = factor * self.alternating_A, factor**2 * self.eddy_W
        return replace(self, volts=none, amperes=factor * currents, alternating_A=alternating, eddy_W=eddy)

    def settled(self, network: HeatNetwork, ambient: float) -> FloatArray | None:
        """Temperatures that last, shape (parts,); None where there are none."""
        start = np.full(len(network.names), ambient)
        if np.isnan(self.volts).all():
            return settled(network, ambient, self.loads(self.currents(start)))
        now = start
        for _ in range(ROUNDS):
            found = np.linalg.solve(network.laplacian, self.powers(now) + network.outwards * ambient)
            if np.abs(found - now).max() < CLOSE_K:
                return np.asarray(found)
            now = 0.5 * (now + found)  # at a held voltage more heat comes of less warmth
            if now.max() > LOST_C:
                break
        return None


def feed_of(
    actuator: Actuator,
    network: HeatNetwork,
    voltage_V: float | Sequence[float] | None,
    current_A: float | Sequence[float] | None,
    alternating_A: float | Sequence[float],
) -> Feed:
    """Feed every circuit with what is given, or else with the most that its supply gives; no eddy currents yet."""
    circuits = actuator.circuits
    if not circuits:
        raise MissingPartError(f"Actuator {actuator.name!r} must have a coil for this; it has none.")
    if voltage_V is not None and current_A is not None:
        raise UsageError("Give either a voltage or a current; both were given.")
    volts, amperes = np.full(len(circuits), np.nan), np.full(len(circuits), np.nan)
    if voltage_V is not None:
        volts = _each(voltage_V, circuits, "voltage_V")
    elif current_A is not None:
        amperes = _each(current_A, circuits, "current_A")
    else:
        for k, circuit in enumerate(circuits):
            drive, held, ends = circuit.drive, volts, (circuit.voltage_min_V, circuit.voltage_max_V)
            if drive.kind == "current" and drive.current_min_A is not None and drive.current_max_A is not None:
                held, ends = amperes, (drive.current_min_A, drive.current_max_A)
            held[k] = max(ends, key=lambda end: (abs(end), end))
        if np.isinf(volts).any():
            raise UsageError("The drawing's supply has no limits; give a voltage or a current.")
    coils = actuator.coils
    member = np.array([[float(coil.circuit == one.name) for coil in coils] for one in circuits])
    drawn = np.array([one.resistance_ohm for one in circuits]) - member @ [coil.resistance_ohm for coil in coils]
    return Feed(
        volts,
        amperes,
        _each(alternating_A, circuits, "alternating_A"),
        np.maximum(drawn, 0.0),
        np.array([one.cold_ohm for one in network.windings]),
        member,
        np.zeros(len(network.names)),
    )


def _each(given: float | Sequence[float], circuits: Sequence[object], name: str) -> FloatArray:
    values = np.asarray(given, dtype=np.float64).reshape(-1)
    if len(values) not in {1, len(circuits)} or not (np.abs(values) <= LARGEST).all():
        raise UsageError(
            f"{name} must be one number up to {LARGEST:.0e}, or one for each of {len(circuits)} circuits; got {given}."
        )
    return np.broadcast_to(values, (len(circuits),))
