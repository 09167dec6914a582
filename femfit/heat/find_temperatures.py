"""Where a drawing's temperatures settle, and what winding and magnet are then, in numbers and in words."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from femfit.core.errors import MissingPartError, UsageError
from femfit.core.numerics import FloatArray
from femfit.core.results import Result, Words
from femfit.core.text import rounded
from femfit.device.load import read_actuator
from femfit.device.parts import REFERENCE_TEMPERATURE, Actuator, LinearMaterial
from femfit.device.thermal import Surroundings
from femfit.heat.balance import Feed, feed_of, hottest, largest_heat, time_until
from femfit.heat.network import HeatNetwork, heat_network

BURNT_C = 300.0
"""Conventional: how warm a winding would become above it is not said; enamels end at 240 degC (IEC 60317)."""

words = Words("femfit.heat", rounded, names={"BURNT_C": BURNT_C}, finite=np.isfinite).sentence


@dataclass(frozen=True)
class MagnetWarmth:
    """A magnet's temperature and remanence."""

    part: str
    temperature_C: float
    change: float  # Of the remanence, relative to 20 degC; zero where its coefficient is not known
    working_C: float | None  # Largest working temperature, where it is known

    @property
    def too_warm(self) -> bool:
        """Whether it is above its largest working temperature; it may stay weaker then."""
        return self.working_C is not None and self.temperature_C > self.working_C * (1.0 + 1e-6)


@dataclass(frozen=True, eq=False, repr=False)
class Temperatures(Result):
    """Where a drawing's parts settle; numbers are NaN where they do not.

    Parameters
    ----------
    names : tuple of str
        Parts, windings first.
    count : int
        Number of windings.
    temperatures_C : array, shape (parts,)
        Of a winding its mean.
    hottest_C : array, shape (windings,)
        Of the hottest strand, about.
    volts, cold_currents_A, currents_A, cold_resistances_ohm, resistances_ohm : arrays, shape (circuits,)
        Of the circuits, ``cold`` as they are switched on.
    heat_W : array, shape (parts,)
        Heat of each.
    settling_s, limit_s : float or None
        Times after switching on when the first winding has warmed by 63 %, and when the hottest strand is at its limit;
        None where never.
    allowed_factor : float
        By what all currents may be multiplied to last; infinite where there is no heat.
    limiting : str
        The part that they bring to its limit.
    at_limit : Temperatures or None
        At the largest currents that may last; None where nothing is heated.

    Examples
    --------
    >>> import femfit as ff
    >>> ff.find_temperatures("rig.toml", current_A=0.8).limiting
    'coil'
    """

    finite = True
    data = (
        *("names", "count", "distance_m", "temperatures_C", "hottest_C", "volts", "cold_currents_A", "currents_A"),
        *("cold_resistances_ohm", "resistances_ohm", "heat_W", "settling_s", "limit_s", "allowed_factor", "limiting"),
        *("allowed_A", "capacities_J_per_K=network.capacities", "conductances_W_per_K=network.between"),
        *("outwards_W_per_K=network.outwards", "magnets", "thermal=surroundings", "settles", "lasts", "at_limit"),
    )

    names: tuple[str, ...]
    count: int
    distance_m: float
    surroundings: Surroundings
    temperatures_C: FloatArray
    hottest_C: FloatArray
    volts: FloatArray
    cold_currents_A: FloatArray
    currents_A: FloatArray
    cold_resistances_ohm: FloatArray
    resistances_ohm: FloatArray
    heat_W: FloatArray
    settling_s: float | None
    limit_s: float | None
    allowed_factor: float
    limiting: str
    magnets: tuple[MagnetWarmth, ...]
    network: HeatNetwork
    at_limit: "Temperatures | None" = None

    @property
    def lasts(self) -> bool:
        """Whether nothing becomes too warm."""
        too_warm = self.hottest_C.max() > self.surroundings.winding_limit_C * (1.0 + 1e-6) or any(
            magnet.too_warm for magnet in self.magnets
        )
        return self.settles and not too_warm

    @property
    def allowed_A(self) -> FloatArray:  # noqa: N802  the unit
        """Currents that may last, in the ratio of those that were found; shape (circuits,)."""
        if not np.isfinite(self.allowed_factor):
            return np.full(len(self.currents_A), np.inf)
        return np.asarray(self.allowed_factor * np.abs(self.currents_A))

    @property
    def settles(self) -> bool:
        """Whether there are temperatures that last."""
        return bool(np.isfinite(self.temperatures_C).all())

    @property
    def windings_C(self) -> FloatArray:  # noqa: N802  the unit
        """Mean temperatures of the windings."""
        return self.temperatures_C[: self.count]

    def __str__(self) -> str:
        return words("heat", "printed", self)


SETTLED = 1.0 - np.exp(-1.0)
"""Of the rise, after one time constant."""


def find_temperatures(
    actuator: Actuator | str | Path,
    *,
    current_A: float | Sequence[float] | None = None,
    voltage_V: float | Sequence[float] | None = None,
    distance_m: float | None = None,
) -> Temperatures:
    """Find the temperatures at which a drawing's parts settle, by a network of its parts.

    Parameters
    ----------
    actuator : Actuator or path
        With ``[thermal]`` where its surroundings are not the usual ones.
    current_A : float, sequence of float, or None
        Held current (rms where it alternates), once for each circuit; the most that the supply gives by default.
    voltage_V : float, sequence of float, or None
        Held voltage in V in place of a current, once for each circuit.
    distance_m : float or None
        Distance at which the moving part is held; by default the first reference distance, or the shortest that it can
        have.

    Raises
    ------
    MissingPartError
        If there is no coil.
    UsageError
        If what is given does not fit together.

    Examples
    --------
    >>> import femfit as ff
    >>> warm = ff.find_temperatures("rig.toml", current_A=0.8)
    >>> print(f"{warm.windings_C[0]:.0f} degC, {warm.resistances_ohm[0]:.2f} ohm")
    61 degC, 3.12 ohm
    """
    actuator = actuator if isinstance(actuator, Actuator) else read_actuator(actuator)
    if distance_m is not None:
        distance = distance_m
    elif actuator.reference_distances_m:
        distance = actuator.reference_distances_m[0]
    else:
        distance = max(min(actuator.sweep.distances_m), actuator.mechanics.ends[0])
    network = heat_network(actuator, distance)
    feed = feed_of(actuator, network, voltage_V, current_A)
    find = partial(_found, actuator.thermal, network, distance)
    result = find(feed)
    if not 0.0 < result.allowed_factor < np.inf:
        return result
    largest_A = result.allowed_factor * result.currents_A
    at_limit = find(replace(feed, volts=np.full_like(feed.volts, np.nan), amperes=largest_A))
    return replace(result, at_limit=replace(at_limit, limit_s=None))  # which it only approaches


def temperatures_at_supply(actuator: Actuator) -> Temperatures | None:
    """Temperatures at the most that a drawing's supply gives; None where it has no coil or no limits."""
    try:
        return find_temperatures(actuator)
    except (MissingPartError, UsageError):
        return None


def _found(around: Surroundings, network: HeatNetwork, distance: float, feed: Feed) -> Temperatures:
    ambient = around.ambient_C
    start, count = np.full(len(network.names), ambient), len(network.windings)
    warm = feed.settled(network, ambient)
    currents = feed.currents(start if np.isnan(warm).any() else warm)
    factor, limiting = largest_heat(network, around, feed.cold_W(currents, len(start)))
    rise = warm[0] - ambient
    until = partial(time_until, network, ambient, feed.powers)
    return Temperatures(
        names=network.names,
        count=count,
        distance_m=distance,
        surroundings=around,
        temperatures_C=warm,
        hottest_C=hottest(network, ambient, warm),
        volts=feed.volts,
        cold_currents_A=feed.currents(start),
        currents_A=currents,
        cold_resistances_ohm=feed.resistances(start),
        resistances_ohm=feed.resistances(warm),
        heat_W=feed.powers(warm),
        settling_s=until(lambda now: float(now[0] - ambient - SETTLED * rise)) if rise > 0.0 else None,
        limit_s=until(lambda now: float(hottest(network, ambient, now).max() - around.winding_limit_C)),
        allowed_factor=float(np.sqrt(factor)),
        limiting=limiting,
        magnets=_magnets(network, warm),
        network=network,
    )


def _magnets(network: HeatNetwork, temperatures: FloatArray) -> tuple[MagnetWarmth, ...]:
    magnets = []
    for region, celsius in zip(network.regions, temperatures[len(network.windings) :], strict=True):
        material = region.material
        if isinstance(material, LinearMaterial) and material.remanence_T:
            change = material.remanence_coefficient_per_K * (celsius - REFERENCE_TEMPERATURE)
            working_C = material.thermal.working_temperature_C
            magnets.append(MagnetWarmth(region.name, float(celsius), float(change), working_C))
    return tuple(magnets)
