"""What is said of a calibration: whether noise is left, what the data leave open, and what is unusual."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from femfit.core.amount import amount, counted, probability, rounded
from femfit.core.arrays import FloatArray
from femfit.identify.calibration.constants import ALIKE, IN_COMBINATION, OPEN, SHOWN, UNUSUAL
from femfit.identify.calibration.fit import Estimate
from femfit.identify.calibration.result import CalibratedNumber, Combination, with_error
from femfit.identify.comparison.lack_of_fit import LackOfFit
from femfit.identify.constants import LEVEL_AFTER, WITHIN_NOISE
from femfit.identify.decision.own_misfit import beyond_own_misfit
from femfit.identify.noise.whitening import NoiseModel
from femfit.identify.noise.within import allowed_for
from femfit.identify.readings.observations import Observations


def verdict(
    observations: Observations,
    noise: NoiseModel,
    test: LackOfFit,
    beyond: Mapping[str, float],
    rms: Mapping[str, float],
) -> str:
    """What is left, in one sentence that the printed errors do not contradict."""
    p = probability(test.p_value)
    if test.p_value <= LEVEL_AFTER:
        return (
            f"The misfit that is left is not noise ({p}): something else is wrong as well, and these numbers may stand "
            "for it. Diagnose with the new model."
        )
    if left := beyond_own_misfit(observations, beyond, rms):
        return f"The test finds nothing in what is left ({p}), but the model misses {' and '.join(left.values())}."
    granted = ["noise"]
    if any(rms[name] > WITHIN_NOISE * sd for name, sd in noise.known.items() if name not in beyond):
        granted.append(allowed_for(observations, noise) or "what runs and settings differ by")
    granted += ["the model's own misfit to the table that it was fitted to"][: len(beyond)]
    return f"What is left is {' and '.join(granted)} ({p})."


def open_combinations(numbers: Sequence[CalibratedNumber], covariance: FloatArray) -> tuple[Combination, ...]:
    """The directions along which the posterior is nearly as wide as the prior, the widest first.

    The eigenvectors of the covariance in units of the tolerances.
    """
    tolerance = np.array([one.tolerance for one in numbers])
    squares, vectors = np.linalg.eigh(covariance / np.outer(tolerance, tolerance))
    found = []
    for k in np.flatnonzero(squares > OPEN**2)[::-1]:
        share = vectors[:, k] / vectors[np.argmax(np.abs(vectors[:, k])), k]
        parts = {
            one.key: float(part * one.tolerance)
            for one, part in zip(numbers, share, strict=True)
            if abs(part) >= IN_COMBINATION
        }
        found.append(Combination(parts, float(np.sqrt(squares[k]))))
    return tuple(found)


def remarks(now: Estimate, numbers: Sequence[CalibratedNumber], left: Sequence[Combination]) -> Iterator[str]:
    """What a reader of the numbers must know besides."""
    yield from now.choice.remarks.values()
    yield from _held([one for one in numbers if one.held])
    units, names = {one.key: one.unit for one in numbers}, {one.key: one.name for one in numbers}
    for one in left[:SHOWN]:
        *others, last = [f"{names[key]} by {_signed(size, units[key])}" for key, size in one.change.items()]
        said, of = f"{', '.join(others)} together with {last}", "what the tolerances leave open of this combination"
        if not others:
            said, of = last.rpartition(" by ")[0], "its tolerance"
        yield f"Not determined by these data: {said}. {amount(min(one.left, 1.0), '')} of {of} is left."
    if len(left) > SHOWN:
        yield f"{counted(len(left) - SHOWN, 'further combination is', 'further combinations are')} not determined."
    for j, k in combinations(range(len(numbers)), 2):
        correlation = now.covariance[j, k] / (numbers[j].sd_as_drawn * numbers[k].sd_as_drawn)
        if abs(correlation) > ALIKE:
            yield (
                f"The errors of {numbers[j].name} and {numbers[k].name} go together (correlation {correlation:.2f}): "
                f"within them, more of one with {'more' if correlation > 0.0 else 'less'} of the other explains these "
                "data as well."
            )
    if any(number.sd > 2.0**0.5 * number.sd_as_drawn for number in numbers):
        yield (
            "These errors come mostly from the numbers that were not fitted, each of which may be off by its "
            "tolerance. Fit more of them (--numbers), or measure them."
        )
    for number, facts in zip(numbers, now.choice.numbers, strict=True):
        away, whole = abs(number.value - number.drawn) / number.tolerance, round(number.value)
        if away > UNUSUAL:
            yield f"{number.name} is {away:.1f} tolerances from its drawn value, which is unusual. Measure it directly."
        if facts.kind == "turns" and number.value != whole:
            off = rounded(abs(number.value - whole) / number.sd_as_drawn, 2)
            yield (
                f"{number.name} is written as found, {number.value:g}, though turns are whole: {whole} is {off} "
                "standard deviations away, the others as found."
            )


def _held(numbers: Sequence[CalibratedNumber]) -> Iterator[str]:
    """Which numbers a tolerance decides that nobody declared, and what the data alone say."""
    for one in numbers[:SHOWN]:
        alone = "the data alone leave it open"
        if one.by_data is not None:
            alone = f"the data alone say {with_error(*one.by_data)} {one.unit}".rstrip()
        yield (
            f"{one.name} is held by a tolerance of {rounded(one.tolerance, 2)} {one.unit}".rstrip()
            + f" that is assumed: {alone}. If it may be further off, write its standard deviation into [tolerances]: "
            f'"{one.key}" = ...'
        )
    if len(numbers) > SHOWN:
        more = counted(len(numbers) - SHOWN, "further number is", "further numbers are")
        yield f"{more} held by assumed tolerances; --json has what the data alone say."


def _signed(value: float, unit: str) -> str:
    return f"{'+' if value >= 0.0 else '-'}{rounded(abs(value), 2)} {unit}".rstrip()
