"""Temperatures that were found, in numbers and in sentences."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.results import Printed
from femfit.core.text import rounded
from femfit.core.words import Words
from femfit.device.thermal import Surroundings
from femfit.heat.network import HeatNetwork

BURNT_C = 300.0
"""Conventional: how warm a winding would become above it is not said; enamels end at 240 degC (IEC 60317)."""

words = Words("femfit.heat", rounded, names={"BURNT_C": BURNT_C}, finite=np.isfinite).sentence


@dataclass(frozen=True)
class MagnetWarmth:
    """A magnet's temperature and remanence."""

    part: str
    temperature_C: float
    change: float  # Of the remanence, relative to 20 degC; zero where its coefficient is not known
    drawn: float  # The same of the drawing's
    working_C: float | None  # Largest working temperature, where it is known

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
        return words("heat", "printed", self)


def _plain(value: Any) -> Any:
    return (
        [None if isinstance(number, float) and np.isnan(number) else number for number in value.tolist()]
        if isinstance(value, np.ndarray)
        else value
    )
