"""The result of a calibration: the drawing's numbers as the data have them, and how far the error fell.

Its sentences say whether noise is left, what the data leave open, and what is unusual.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.results import Finding, Result, json_ready
from femfit.core.text import rounded
from femfit.device.drawn_numbers import NumberFacts
from femfit.device.keys import unit_of
from femfit.effects.effect import AddedEffect
from femfit.identify.before_after import fit_facts, of_last_run, unseen_error
from femfit.identify.calibration.fit import Estimate, Redrawn
from femfit.identify.constants import CALIBRATION_SETTLED, IN_COMBINATION, OPEN, WITHIN_NOISE
from femfit.identify.decision.remarks import guessed_noises
from femfit.identify.lack_of_fit import LackOfFit
from femfit.identify.misfit import ErrorFall, allowed, beyond_noise
from femfit.identify.noise.whitening import Whitening
from femfit.identify.words import printed, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.with_effects import nominal_of, with_effects
from femfit.tables.sweep_table import SweepTable


@dataclass(frozen=True)
class CalibratedNumber:
    """A number of the drawing as the data have it."""

    key: str  # Key path in the file
    also: tuple[str, ...]  # Key paths of what moved with it
    drawn: float
    value: float
    sd: float  # Of the value, after the data, with what the numbers that were not fitted may be off by
    sd_as_drawn: float  # The same, were these exactly as drawn
    tolerance: float  # Standard deviation before the data
    unit: str  # Of all five; empty of a pure number, and of the factor of a curve
    label: str  # What texts call it

    @classmethod
    def of(cls, facts: NumberFacts, value: float, sd: float, sd_as_drawn: float) -> Self:
        """The number of a drawing."""
        unit = "" if facts.kind.startswith("curve_") else unit_of(facts.key.partition("[")[0])
        return cls(facts.key, facts.also, facts.value, value, sd, sd_as_drawn, facts.deviation, unit, facts.title)

    @property
    def texts(self) -> tuple[str, ...]:
        """A row of the printed table."""
        # Value and standard deviation both to the second digit of that
        places = max(0, 1 - math.floor(math.log10(self.sd))) if self.sd > 0.0 else 6
        value = f"{self.value:.{places}f} ± {self.sd:.{places}f}"
        numbers = (f"{self.drawn:g}", value, f"± {rounded(self.sd_as_drawn, 2)}", rounded(self.tolerance, 2))
        return (self.label, *(f"{text} {self.unit}".rstrip() for text in numbers))


@dataclass(frozen=True)
class Combination:
    """Changes of several numbers at once that the data hardly see."""

    change: dict[str, float]  # By key path, in the number's unit, the largest by one tolerance
    left: float  # Its standard deviation over that of the tolerances alone


@dataclass(frozen=True, eq=False, repr=False)
class CalibrationResult(Result):
    """A drawing calibrated on measurements; printed, it is what ``femfit calibrate`` prints.

    Examples
    --------
    >>> import femfit as ff
    >>> place, effects = "sensors.hall.z_mm", ["core_saturation"]
    >>> calibrated = ff.calibrate("rig.toml", "bench.csv", "runs/rig", numbers=place, effects=effects)
    >>> [number.key for number in calibrated.numbers]
    ['sensors.hall.z_mm']
    """

    data = (
        *("verdict", "beyond_noise", "sweeps", "step", "settled", "remarks", "numbers", "covariance", "undetermined"),
        *("lack_of_fit", "findings", "error_on_runs_left_out=unseen", "error_on_readings_fitted=fitted"),
        "beside=effects_beside",
    )

    drawing: str  # Its text: that of the old one with other numbers
    table: SweepTable  # Its sweep
    model: ActuatorModel  # Fitted to that, with the effects beside the numbers
    model_as_drawn: ActuatorModel  # The same of the drawing as it was, without effects
    numbers: tuple[CalibratedNumber, ...]
    covariance: FloatArray  # Of these, in their units and order
    beside: tuple[AddedEffect, ...]  # Effects that are no numbers of the drawing, fitted together with them
    # The error of the drawing as it was, and of the calibrated one on runs that were not fitted, each in turn; None
    # where there is one run alone
    unseen: ErrorFall | None
    fitted: ErrorFall  # The same on the readings that were fitted, of the drawing as swept
    undetermined: tuple[Combination, ...]  # What the data know hardly better than the tolerances do
    lack_of_fit: LackOfFit  # Of the calibrated drawing with the effects beside it
    # Channels whose printed error is more than 1.2 times what declared noise, or repeats, show, in times the noise
    beyond_noise: Mapping[str, float]
    verdict: str  # What is left
    sweeps: int
    step: float  # That was not taken any more, in standard errors, root mean square
    settled: bool  # Whether it is short against these
    remarks: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()

    @classmethod
    def of(cls, first: Redrawn, last: Estimate) -> Self:
        """What an estimate says beside the drawing as it was."""
        whitening, fit = last.redrawn.whitening, last.fit
        observations, noise = whitening.observations, whitening.noise
        facts = fit_facts(whitening, (), last.beside, fit.jacobian[:, ~fit.active])
        before = first.whitening.observations.rms(first.whitening.observations.residual)
        fitted = unseen = ErrorFall(tuple(replace(c, rms_before=before[c.channel]) for c in facts["fall"].channels))
        if observations.runs > 1:  # numbers and effects fitted to the other runs, about the calibrated drawing
            left_out = unseen_error(whitening, fit)
            unseen = ErrorFall(tuple(replace(fall, rms_after=left_out[fall.channel]) for fall in fitted.channels))
        rms = {name: max(fitted.rms_after[name], unseen.rms_after[name]) for name in observations.channels}
        sds = (np.sqrt(np.diag(covariance)).tolist() for covariance in (last.error, last.covariance))
        numbers = tuple(
            CalibratedNumber.of(*values) for values in zip(last.choice.numbers, last.values.tolist(), *sds, strict=True)
        )
        undetermined = open_combinations(numbers, last.covariance)
        return cls(
            drawing=last.redrawn.drawing.text,
            table=last.redrawn.table,
            model=with_effects(last.redrawn.model, of_last_run(last.beside, observations)),
            model_as_drawn=first.model,
            numbers=numbers,
            covariance=last.error,
            beside=last.beside,
            unseen=unseen if observations.runs > 1 else None,
            fitted=fitted,
            undetermined=undetermined,
            lack_of_fit=facts["lack_of_fit_after"],
            beyond_noise=beyond_noise(observations, noise, rms),
            verdict=verdict(whitening, facts["lack_of_fit_after"], rms),
            sweeps=last.redrawn.sweeps,
            step=last.step,
            settled=last.step <= CALIBRATION_SETTLED,
            remarks=remarks(last, numbers, undetermined),
            findings=(*observations.findings, *guessed_noises(noise)),
        )

    @property
    def effects_beside(self) -> list[dict[str, Any]]:
        """The effects beside the numbers, and in which runs they act."""
        return [json_ready(added) | {"runs": added.runs} for added in self.beside]

    def __str__(self) -> str:
        rows = [
            ("number", "drawn", "calibrated", "rest as drawn", "tolerance"),
            *(number.texts for number in self.numbers),
        ]
        widths = [max(len(row[k]) for row in rows) for k in range(5)]
        table = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
        return printed("calibration", r=self, table=table, nominal=nominal_of(self.model.without_effects))


def heading(result: CalibrationResult, drawing: str, data: Sequence[str]) -> str:
    """The comment above a calibrated drawing: what it was made from, and which numbers are not as drawn."""
    texts = [(number.key, *number.texts) for number in result.numbers]
    rows = [f"#   {label} [{key}] = {value} (drawn {drawn})" for key, label, drawn, value, *_ in texts]
    end = "\r\n" if "\r\n" in result.drawing else "\n"
    lines = [f"# Calibrated by femfit from {drawing} and {', '.join(data)}:", *rows, "", ""]
    return end.join(lines).replace("±", "+-")


def verdict(whitening: Whitening, test: LackOfFit, rms: Mapping[str, float]) -> str:
    """What is left, in one sentence that the printed errors do not contradict."""
    facts, noise = allowed(whitening.observations, whitening.noise, rms), whitening.noise
    more = any(rms[name] > WITHIN_NOISE * sd for name, sd in noise.known.items() if name not in facts["beyond"])
    return sentence("calibration", "verdict", facts, test.p_value, more)


def open_combinations(numbers: Sequence[CalibratedNumber], covariance: FloatArray) -> tuple[Combination, ...]:
    """The directions along which the posterior is nearly as wide as the prior, the widest first.

    The eigenvectors of the covariance in units of the tolerances.
    """
    tolerance = np.array([number.tolerance for number in numbers])
    squares, vectors = np.linalg.eigh(covariance / np.outer(tolerance, tolerance))
    result = []
    for k in np.flatnonzero(squares > OPEN**2)[::-1]:
        share = vectors[:, k] / vectors[np.argmax(np.abs(vectors[:, k])), k]
        parts = {
            number.key: float(weight * number.tolerance)
            for number, weight in zip(numbers, share, strict=True)
            if abs(weight) >= IN_COMBINATION
        }
        result.append(Combination(parts, float(np.sqrt(squares[k]))))
    return tuple(result)


def remarks(
    last: Estimate, numbers: Sequence[CalibratedNumber], undetermined: Sequence[Combination]
) -> tuple[str, ...]:
    """What a reader of the numbers must know besides."""
    away = [abs(number.value - number.drawn) / number.tolerance for number in numbers]
    text = printed(
        "calibration_remarks",
        remarks=last.choice.remarks.values(),
        undetermined=undetermined,
        by_key={number.key: number for number in numbers},
        mostly_unfitted=any(number.sd > 2.0**0.5 * number.sd_as_drawn for number in numbers),
        checked=zip(numbers, last.choice.numbers, away, strict=True),
    )
    return tuple(text.splitlines())
