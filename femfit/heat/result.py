"""Temperatures that were found, in numbers and in sentences."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.results import Printed
from femfit.core.text import amount, amount_range, rounded
from femfit.device.thermal import Surroundings
from femfit.heat.network import HeatNetwork

BURNT_C = 300.0
"""Conventional: how warm a winding would become above it is not said; enamels end at 240 degC (IEC 60317)."""

ASSUMED = (
    "Assumed: air of {ambient_C:g} °C, {film_W_per_m2_K:g} W/(m² K) from free faces, {insulation_W_per_m_K:g} W/(m K) "
    "between strands, {mounting_W_per_K:g} W/K through the mounting. [thermal] in the drawing changes this."
)


@dataclass(frozen=True)
class MagnetWarmth:
    """A magnet's temperature and remanence."""

    part: str
    temperature_C: float
    change: float  # Of the remanence, relative to 20 degC; zero where its coefficient is not known
    drawn: float  # The same of the drawing's
    working_C: float | None  # Largest working temperature, where it is known

    def __str__(self) -> str:
        text = f"{self.part}: {amount(self.temperature_C, 'C')}, remanence"
        if self.change:
            return f"{text} {_less(-self.change)} than at 20 °C."
        return f"{text} as drawn (its material has no remanence_coefficient_per_K)."

    @property
    def too_warm(self) -> bool:
        """Whether it is above its largest working temperature; it may stay weaker then."""
        return self.working_C is not None and self.temperature_C > self.working_C * (1.0 + 1e-6)


@dataclass(frozen=True, eq=False, repr=False)
class Temperatures(Printed):
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
    spread_C : array, shape (2,)
        Means of the warmest winding where free faces give off half as much again, and two thirds.
    volts, cold_currents_A, currents_A, alternating_A, cold_resistances_ohm, resistances_ohm : arrays, shape (circuits,)
        Of the circuits, ``cold`` as they are switched on.
    heat_W, eddy_W : arrays, shape (parts,)
        All heat, and that of eddy currents.
    settling_s, limit_s : float or None
        Times after switching on when the first winding has warmed by 63 %, and when the hottest strand is at its limit;
        None where never.
    allowed_factor : float
        By what all currents may be multiplied to last; infinite where there is no heat.
    limiting : str
        The part that they bring to its limit.
    force : tuple of float, or None
        In N, as it is switched on and warm; None without a model, or outside of what it knows.
    at_limit : Temperatures or None
        At the largest currents that may last; None where nothing is heated.

    Examples
    --------
    >>> import femfit as ff
    >>> ff.find_temperatures("rig.toml", current_A=0.8).limiting
    'coil'
    """

    names: tuple[str, ...]
    count: int
    distance_m: float
    surroundings: Surroundings
    temperatures_C: FloatArray
    hottest_C: FloatArray
    spread_C: FloatArray
    volts: FloatArray
    cold_currents_A: FloatArray
    currents_A: FloatArray
    alternating_A: FloatArray
    cold_resistances_ohm: FloatArray
    resistances_ohm: FloatArray
    heat_W: FloatArray
    eddy_W: FloatArray
    settling_s: float | None
    limit_s: float | None
    allowed_factor: float
    limiting: str
    magnets: tuple[MagnetWarmth, ...]
    force: tuple[float, float] | None
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
        """Rms currents that may last, in the ratio of those that were found; shape (circuits,)."""
        if not np.isfinite(self.allowed_factor):
            return np.full(len(self.currents_A), np.inf)
        return np.asarray(self.allowed_factor * np.hypot(self.currents_A, self.alternating_A))

    @property
    def settles(self) -> bool:
        """Whether there are temperatures that last."""
        return bool(np.isfinite(self.temperatures_C).all())

    @property
    def windings_C(self) -> FloatArray:  # noqa: N802  the unit
        """Mean temperatures of the windings."""
        return self.temperatures_C[: self.count]

    @property
    def released_W(self) -> FloatArray:  # noqa: N802  the unit
        """Heat that each part's own faces and the mounting give to the surroundings, shape (parts,)."""
        return np.asarray(self.network.released @ np.append(self.temperatures_C, self.surroundings.ambient_C))

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        left_out = {"network", "magnets", "at_limit", "surroundings"}
        data = {name: _plain(value) for name, value in vars(self).items() if name not in left_out}
        return {
            **data,
            "allowed_A": _plain(self.allowed_A),
            "released_W": _plain(self.released_W),
            "settles": self.settles,
            "lasts": self.lasts,
            "at_limit": self.at_limit and self.at_limit.to_dict(),
            "magnets": [vars(magnet) for magnet in self.magnets],
            "thermal": vars(self.surroundings),
            "capacities_J_per_K": self.network.capacities.tolist(),
            "conductances_W_per_K": self.network.between.tolist(),
            "outwards_W_per_K": self.network.outwards.tolist(),
        }

    def __str__(self) -> str:
        if self.lasts:
            lines = [*self.settled_lines(), self._allowed()]
        else:
            lines = [self._too_warm(), self._allowed(), *(self.at_limit.settled_lines() if self.at_limit else ())]
        return "\n".join([*lines, ASSUMED.format(**vars(self.surroundings))])

    def settled_lines(self) -> list[str]:
        """Where it settles, without what it may carry and what is assumed."""
        lines = [self._answer(), self._electric(), *map(str, self.magnets)]
        if self.force is not None and self.force[0]:
            cold, warm = self.force
            distance = amount(self.distance_m, "m", 3)
            lines.append(
                f"The force at {distance} is then {amount(warm, 'N', 3)}, {_less(1.0 - warm / cold)} than cold."
            )
        return lines

    def _fed(self) -> str:
        fed = [
            amount(volt, "V", 3) if np.isfinite(volt) else amount(ampere, "A", 3)
            for volt, ampere in zip(self.volts, self.cold_currents_A, strict=True)
        ]
        if not self.alternating_A.any():
            return " and ".join(fed)
        waves = " and ".join(amount(current, "A", 3) for current in self.alternating_A)
        return f"{' and '.join(fed)} and {waves} rms alternating" if self.cold_currents_A.any() else f"{waves} rms"

    def _too_warm(self) -> str:
        text = f"{self._fed()} may not last. "
        if self.limit_s is not None:
            limit = amount(self.surroundings.winding_limit_C, "C")
            text += f"The hottest strand passes {limit} after {_time(self.limit_s)}"
            warmest = float(self.hottest_C.max())
        else:
            (magnet, *_) = [magnet for magnet in self.magnets if magnet.too_warm]
            text += f"The magnet {magnet.part} becomes too warm"
            warmest = magnet.temperature_C
        if not self.settles:
            return f"{text}, and never settles: its heat grows with its resistance faster than it flows off."
        temperature = f"at {amount(warmest, 'C')}" if warmest < BURNT_C else f"above {amount(BURNT_C, 'C')}"
        return f"{text}; it would settle {temperature}."

    def _answer(self) -> str:
        each = ", ".join(f"{name} {amount(mean, 'C')}" for name, mean in zip(self.names, self.windings_C, strict=False))
        low, high = self.spread_C
        spread = f"be {amount_range(low, high, 'C', 3)}" if np.isfinite(high) else f"be {amount(low, 'C')} or run away"
        settles = f"the winding settles at {amount(self.windings_C[0], 'C')}"
        if self.count > 1:
            settles = f"the windings settle at {each}"
        return (
            f"{self._fed()} for ever: {settles}, {amount(float(self.hottest_C.max()), 'C')} in the hottest strand. "
            f"The first {_time(self.settling_s)} bring 63 % of the rise. How well air cools is known within a factor "
            f"of 1.5: it may {spread}."
        )

    def _electric(self) -> str:
        changes = zip(self.cold_resistances_ohm, self.resistances_ohm, strict=True)
        text = f"Resistance {_instead(changes, 'ohm')}"
        if np.isfinite(self.volts).any():
            text += f", current {_instead(zip(self.cold_currents_A, self.currents_A, strict=True), 'A')}"
        text += f"; heat {amount(float(self.heat_W.sum()), 'W', 3)}"
        eddy = float(self.eddy_W.sum())
        return f"{text}, {amount(eddy, 'W', 3)} of it by eddy currents." if eddy else f"{text}."

    def _allowed(self) -> str:
        if not self.limiting:
            return "No winding is heated."
        currents = " and ".join(amount(float(allowed), "A", 3) for allowed in self.allowed_A)
        of_magnets = {magnet.part: magnet.working_C for magnet in self.magnets if magnet.working_C is not None}
        limit = amount(of_magnets.get(self.limiting, self.surroundings.winding_limit_C), "C")
        limited = self.limiting if self.limiting in of_magnets else f"the hottest strand of {self.limiting}"
        return f"The largest current that may last is {currents}: {limited} is then at its limit of {limit}."


def _instead(changes: Iterable[tuple[float, float]], unit: str) -> str:
    return " and ".join(f"{amount(warm, unit, 3)} instead of {amount(cold, unit, 3)}" for cold, warm in changes)


def _less(share: float) -> str:
    return f"{rounded(100.0 * abs(share), 2)} % {'less' if share >= 0.0 else 'more'}"


def _time(seconds: float | None) -> str:
    if seconds is None:
        return "a time not known"
    return f"{rounded(seconds / 60.0, 2)} min" if seconds >= 120.0 else f"{rounded(seconds, 2)} s"


def _plain(value: Any) -> Any:
    return (
        [None if isinstance(number, float) and np.isnan(number) else number for number in value.tolist()]
        if isinstance(value, np.ndarray)
        else value
    )
