"""The short law that a part of a remainder follows, where one does.

Each candidate has one shape at most and one or two factors. It is projected on the part's splines, so that its columns
are those of the part, and fitted to what the part changes of the whitened readings; its share is that of the square.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.text import amount
from femfit.identify.noise.whitening import Whitening
from femfit.identify.remainder.constants import PER_FACTOR, SAID
from femfit.identify.remainder.learn import Learnt
from femfit.identify.remainder.parts import BRAKE, COENERGY, FORCE_BRANCH, HALL_FIELD, RESISTANCE, UNITS, Part

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


@dataclass(frozen=True, eq=False)
class _Form:
    """Functions at points, shape (n, factors), and the text for their factors."""

    values: FloatArray
    text: Callable[[FloatArray], str]


def short_law(whitening: Whitening, learnt: Learnt, part: Part) -> ShortLaw:
    """The candidate of largest share, with a small price for a second factor."""
    points = _points(part)
    forms = _field_forms(part, *points) if len(points) == 2 else _curve_forms(part, points[0])
    onto = np.linalg.pinv(part.rows(*points))
    columns = whitening.full(learnt.columns[:, learnt.own(part)])
    target = columns @ learnt.coefficients[part]
    square, best = float(target @ target), (ShortLaw(part.kind, "", 0.0), 0.0)
    for form in forms:
        own = columns @ (onto @ form.values)
        factors = np.asarray(np.linalg.lstsq(own, target, rcond=1e-10)[0], np.float64)
        share = 1.0 - float(np.sum((target - own @ factors) ** 2)) / max(square, 1e-300)
        worth = share - PER_FACTOR * form.values.shape[1]
        if worth > best[1]:
            best = ShortLaw(part.kind, form.text(factors), share), worth
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
            yield _Form((shape * (i / max(peak, 1e-300)) ** power)[:, None], _factor(unit, words))


def _factor(unit: str, words: str) -> Callable[[FloatArray], str]:
    return lambda factors: f"{amount(float(factors[0]), unit)}{words}"


def _curve_forms(part: Part, x: FloatArray) -> Iterator[_Form]:
    """Powers, pairs of powers, a decay, a limit, and over the distance a period."""
    symbol, of = _SYMBOLS[part.kind]
    unit, most, span = UNITS[part.kind], float(np.abs(x).max()), float(np.ptp(x))
    over = f"({symbol} / {amount(most, of)})"
    powers = ["", f" {over}", f" {over}^2", f" {over}^3"]
    each = [(x / most) ** n for n in range(4)]
    for n, words in enumerate(powers):
        yield _Form(each[n][:, None], _factor(unit, words))
    for n, m in ((0, 1), (0, 2), (1, 2), (1, 3)):
        yield _Form(np.stack([each[n], each[m]], axis=1), _sum(unit, powers[n], powers[m]))
    for a in np.geomspace(span / 30.0, 3.0 * span, 40).tolist():
        words = f" exp(-({symbol} - {amount(float(x.min()), of)}) / {amount(a, of)})"
        yield _Form(np.exp((x.min() - x) / a)[:, None], _factor(unit, words))
        yield _Form(np.tanh(x / a)[:, None], _factor(unit, f" tanh({symbol} / {amount(a, of)})"))
    if part.kind == _DISTANCE:
        for period in span / np.arange(1.0, 16.0, 0.05):
            phase = 2.0 * np.pi * x / period
            yield _Form(np.stack([np.sin(phase), np.cos(phase)], axis=1), _wave(unit, float(period)))


def _sum(unit: str, first: str, second: str) -> Callable[[FloatArray], str]:
    return lambda factors: f"{amount(float(factors[0]), unit)}{first} + {amount(float(factors[1]), unit)}{second}"


def _wave(unit: str, period: float) -> Callable[[FloatArray], str]:
    def text(factors: FloatArray) -> str:
        size, phase = float(np.hypot(*factors)), float(np.arctan2(factors[1], factors[0]))
        return f"{amount(size, unit)} sin(2 pi d / {amount(period, 'm', 3)} {phase:+.2f})"

    return text


def laws_of(whitening: Whitening, learnt: Learnt) -> tuple[ShortLaw, ...]:
    """The best candidate of each part."""
    return tuple(short_law(whitening, learnt, part) for part in learnt.coefficients)


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
