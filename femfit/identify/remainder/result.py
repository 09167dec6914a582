"""What learning a remainder says: the short law of each part, and the measurement that would refute it.

Each candidate of a law has one shape at most and one or two factors. It is projected on the part's splines, so that its
columns are those of the part, and fitted to what the part changes of the whitened readings; its share is that of the
square. A remainder is refuted where it and nothing differ most, and nobody has measured yet.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from femfit.core.numerics import FloatArray
from femfit.core.text import amount
from femfit.effects.conditions import Conditions
from femfit.effects.words import titled, titles_of
from femfit.identify.add_result import AddResult
from femfit.identify.constants import HELPS
from femfit.identify.noise.whitening import NoiseModel, Whitening
from femfit.identify.observations import Observations
from femfit.identify.remainder.constants import LEVELS, PER_FACTOR, SAID, UNMEASURED
from femfit.identify.remainder.learn import Learnt
from femfit.identify.remainder.parts import BRAKE, COENERGY, FORCE_BRANCH, HALL_FIELD, RESISTANCE, UNITS, WORDS, Part
from femfit.identify.series.balances import FORCE_BALANCE
from femfit.identify.words import plain, printed, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.readings import predict_readings

_DISTANCE = "distance_m"
_SYMBOLS = {_DISTANCE: ("d", "m"), "current_A": ("i", "A"), RESISTANCE: ("|i|", "A"), BRAKE: ("|v|", "m/s")} | {
    "force_N": ("F", "N"),
    FORCE_BRANCH: ("F", "N"),
    "flux_linkage_Wb": ("flux", "Wb"),
    "hall_V": ("V", "V"),
}
_POWERS = ("", " i/{i}", " (i/{i})^2")


@dataclass(frozen=True)
class ShortLaw:
    """A formula in place of a part."""

    kind: str
    text: str
    share: float  # Of the square of what the part changes of the whitened readings

    @property
    def fits(self) -> bool:
        """Whether it may be said to be the part."""
        return self.share >= SAID

    def __str__(self) -> str:
        return sentence("remainder", "law", self, DEFINITIONS[self.kind])


_Form = tuple[Callable[[FloatArray], str], tuple[FloatArray, ...]]
"""The text for the factors of functions, and the functions at points, each of shape (n,)."""


def short_law(whitening: Whitening, learnt: Learnt, part: Part) -> ShortLaw:
    """The candidate of largest share, with a small price for a second factor."""
    points = _points(part)
    forms = _field_forms(part, *points) if len(points) == 2 else _curve_forms(part, points[0])
    onto = np.linalg.pinv(part.rows(*points))
    columns = whitening.full(learnt.columns[part])
    target = columns @ learnt.coefficients[part]
    square, best = float(target @ target), (ShortLaw(part.kind, "", 0.0), 0.0)
    for text, functions in forms:
        candidate = columns @ (onto @ np.stack(functions, axis=1))
        factors = np.asarray(np.linalg.lstsq(candidate, target, rcond=1e-10)[0], np.float64)
        share = 1.0 - float(np.sum((target - candidate @ factors) ** 2)) / max(square, 1e-300)
        worth = share - PER_FACTOR * len(functions)
        if worth > best[1]:
            best = ShortLaw(part.kind, text(factors), share), worth
    return best[0]


def _points(part: Part) -> tuple[FloatArray, ...]:
    """Points over the data, of each of the part's variables, the first in its coordinate."""
    count = 25 if len(part.axes) == 2 else 400
    axes = [np.linspace(axis.low, axis.high, count) for axis in part.axes]
    return tuple(grid.ravel() for grid in np.meshgrid(*axes, indexing="ij"))


def _field_forms(part: Part, u: FloatArray, i: FloatArray) -> Iterator[_Form]:
    """Products of a function of the distance and a power of the current."""
    d, peak = part.coordinate.distance(u), float(np.abs(i).max())
    near, travel, unit = float(d.min()), float(np.ptp(d)), UNITS[part.kind]
    nearest = amount(near, "m")
    shapes = [(np.ones_like(d), ""), (d / np.abs(d).max(), f" d/({amount(float(np.abs(d).max()), 'm')})")]
    shapes += [
        (np.exp((near - d) / a), f" exp(-(d - {nearest}) / {amount(float(a), 'm')})")
        for a in np.geomspace(travel / 30.0, 3.0 * travel, 40)
    ]
    if near > 0.0:
        for power in (1, 2, 3, 4):
            for a in (0.0, *np.geomspace(0.05 * near, 3.0 * near, 12)):
                beside = f"(d + {amount(float(a), 'm')})" if a else "d"
                shapes.append((((near + a) / (d + a)) ** power, f" ({amount(near + a, 'm')} / {beside})^{power}"))
    for shape, of_distance in shapes:
        for power, of_current in enumerate(_POWERS):
            if power and peak == 0.0:
                continue
            words = of_current.format(i=f"({amount(peak, 'A')})") + of_distance
            yield partial(_sum, unit, (words,)), (shape * (i / max(peak, 1e-300)) ** power,)


def _sum(unit: str, words: Sequence[str], factors: FloatArray) -> str:
    """Functions in words, each with its factor."""
    return " + ".join(f"{amount(float(factor), unit)}{word}" for factor, word in zip(factors, words, strict=True))


def _wave(unit: str, period: float, factors: FloatArray) -> str:
    """A sine and a cosine as one wave."""
    size, phase = float(np.hypot(*factors)), float(np.arctan2(factors[1], factors[0]))
    return f"{amount(size, unit)} sin(2 pi d / {amount(period, 'm', 3)} {phase:+.2f})"


def _curve_forms(part: Part, x: FloatArray) -> Iterator[_Form]:
    """Powers, pairs of powers, a decay, a limit, and over the distance a period."""
    symbol, of = _SYMBOLS[part.kind]
    unit, most, span = UNITS[part.kind], float(np.abs(x).max()), float(np.ptp(x))
    over = f"({symbol} / {amount(most, of)})"
    powers = ["", f" {over}", f" {over}^2", f" {over}^3"]
    each = [(x / most) ** n for n in range(4)]
    for n, words in enumerate(powers):
        yield partial(_sum, unit, (words,)), (each[n],)
    for n, m in ((0, 1), (0, 2), (1, 2), (1, 3)):
        yield partial(_sum, unit, (powers[n], powers[m])), (each[n], each[m])
    for a in np.geomspace(span / 30.0, 3.0 * span, 40).tolist():
        words = f" exp(-({symbol} - {amount(float(x.min()), of)}) / {amount(a, of)})"
        yield partial(_sum, unit, (words,)), (np.exp((x.min() - x) / a),)
        yield partial(_sum, unit, (f" tanh({symbol} / {amount(a, of)})",)), (np.tanh(x / a),)
    if part.kind == _DISTANCE:
        for period in span / np.arange(1.0, 16.0, 0.05):
            phase = 2.0 * np.pi * x / period
            yield partial(_wave, unit, float(period)), (np.sin(phase), np.cos(phase))


DEFINITIONS = {
    COENERGY: "dW'",
    HALL_FIELD: "dB",
    BRAKE: "brake",
    RESISTANCE: "further resistance",
    "distance_m": "true less recorded distance",
    "current_A": "true less recorded current",
    "force_N": "recorded less true force",
    FORCE_BRANCH: "recorded less true force while the current rises, the other way round while it falls",
    "flux_linkage_Wb": "recorded less true flux linkage",
    "hall_V": "recorded less true Hall output",
}
"""What each part's function is, as the left side of its law."""


_READS = {FORCE_BALANCE: "force_N", "voltage_balance_V": "voltage_V"}


@dataclass(frozen=True)
class Refutation:
    """A reading that the remainder says to be another than the model's."""

    channel: str
    distance_m: float
    current_A: float
    velocity_m_s: float
    change: float  # With the remainder less without
    noise: float  # Standard deviation of one reading
    measured: bool  # Whether something was measured next to it

    def __str__(self) -> str:
        return sentence("remainder", "refutation", self)


def refutation(
    before: ActuatorModel, after: ActuatorModel, observations: Observations, noise: NoiseModel
) -> Refutation | None:
    """The reading at which the remainder says most over its noise; None where it changes no static reading."""
    table = observations.covariates
    measured = [table[name].to_numpy() for name in ("distance_m", "current_A")]
    ends = [(float(x.min()), float(x.max())) for x in measured]
    speed = table["velocity_m_s"].abs().max() if "velocity_m_s" in table else 0.0
    braked = any(added.effect.force is not None for added in after.effects[len(before.effects) :])
    d, i = (np.ravel(x) for x in np.meshgrid(*(np.linspace(*e, n) for e, n in zip(ends, LEVELS, strict=True))))
    velocity = float(speed) if braked else 0.0
    conditions = Conditions(observations.nominal, velocity_m_s=velocity)
    readings = [predict_readings(model, d, i, conditions) for model in (before, after)]
    # Distance of settings from the nearest that was measured, over the ranges of the data
    spans = [max(high - low, 1e-300) for low, high in ends]
    visited = np.unique(np.round(np.stack([x / s for x, s in zip(measured, spans, strict=True)], axis=1), 3), axis=0)
    far = np.asarray(cKDTree(visited).query(np.stack([d / spans[0], i / spans[1]], axis=1))[0])
    best: tuple[float, Refutation] | None = None
    for name, sigma in noise.floor.items():
        read = _READS.get(name, name)
        if name not in noise.source or read not in readings[0]:
            continue
        change = readings[1][read] - readings[0][read]
        new = far > UNMEASURED
        score = np.abs(change) / sigma * np.where(new, 1.0, 0.5 if new.any() else 1.0)
        k = int(np.argmax(score))
        if score[k] > 0.0 and (best is None or score[k] > best[0]):
            values = (float(d[k]), float(i[k]), velocity, float(change[k]), sigma, not bool(new[k]))
            best = float(score[k]), Refutation(read, *values)
    return None if best is None else best[1]


@dataclass(frozen=True, eq=False, repr=False)
class RemainderResult(AddResult):
    """A remainder added to a model as the effect ``unexplained``; printed, it is what ``femfit add`` prints.

    Parameters
    ----------
    parts : tuple of str
        Where it acts: ``coenergy``, ``hall_field``, ``brake``, ``resistance``, or the setting or channel that is read
        wrongly; none where nothing beyond the noise is left.
    laws : tuple of ShortLaw
        For each part the short law that is nearest to it.
    alternatives : tuple of tuple of str
        Other parts that these readings leave possible.
    fall_unseen : float
        By how much it lowers the weighted sum of squares on runs left out.
    named_instead : str
        An effect of the catalogue that explains as much by itself; then the remainder is not accepted.
    beside : AddResult or None
        Effects that were added first.

    Examples
    --------
    >>> import femfit as ff
    >>> better = ff.add_effects(ff.read_model("model.json"), "bench.csv", "unexplained")
    >>> better.model.effects[-1].effect.name
    'unexplained'
    """

    parts: tuple[str, ...] = ()
    laws: tuple[ShortLaw, ...] = ()
    alternatives: tuple[tuple[str, ...], ...] = ()
    fall_unseen: float = 0.0
    refutation: Refutation | None = None
    named_instead: str = ""
    beside: AddResult | None = None

    @property
    def accepted(self) -> bool:
        """Whether it helps on runs left out, the filter is not worse, and no name explains as much."""
        filtered = self.filter is None or self.filter.accepted
        return bool(self.parts) and self.fall_unseen > HELPS and filtered and not self.named_instead

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data, without the model."""
        names = ("parts", "alternatives", "laws", "fall_unseen", "refutation", "named_instead")
        learnt = {name: plain(getattr(self, name)) for name in names}
        return super().to_dict() | {"remainder": learnt, "beside": plain(self.beside)}

    def __str__(self) -> str:
        text = printed("remainder", r=self, words=WORDS, rms={}, magnitude={}, beyond={})
        return titled(text, titles_of(self.observations.nominal.drawn))

    @property
    def sentences(self) -> list[str]:
        """The short law of each part, what else it may be, and the measurement that would refute it."""
        also = sentence("remainder", "also", self.alternatives, WORDS)
        refuting = str(self.refutation) if self.refutation else ""
        return [*map(str, self.laws), *filter(None, (also, refuting))]


def words_of(laws: tuple[ShortLaw, ...], parts: tuple[str, ...]) -> str:
    """What the effect is, as the clause that is printed wherever it is described."""
    texts = {law.kind: law.text for law in laws if law.fits}
    each = (f"{DEFINITIONS[kind]} near {texts[kind]}" if kind in texts else WORDS[kind] for kind in parts)
    return f"of no known cause; {' and '.join(each)}"
