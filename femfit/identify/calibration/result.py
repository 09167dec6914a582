"""What a calibration says: the drawing's numbers as the data have them, and how far the error fell."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from femfit.core.amount import amount, counted, probability
from femfit.core.arrays import FloatArray
from femfit.core.finding import Finding
from femfit.core.printed import Printed
from femfit.effects.effect import AddedEffect
from femfit.effects.words import describe
from femfit.identify.calibration.constants import SHOWN, UNUSUAL
from femfit.identify.calibration.open_directions import Combination, alike
from femfit.identify.comparison.fall import ErrorFall
from femfit.identify.comparison.lack_of_fit import LackOfFit
from femfit.identify.constants import LEVEL_AFTER
from femfit.identify.noise.within import in_words
from femfit.identify.readings.place import notes, suspicions
from femfit.model.actuator_model import ActuatorModel
from femfit.model.with_effects import nominal_of
from femfit.tables.measurement import CHANNEL_WORDS
from femfit.tables.sweep_table import SweepTable

_NOTHING_UNSEEN = (
    "There is one run alone, so that no reading was left out of the fit: measure another run to see whether the "
    "calibration holds. On the readings that were fitted, the drawing swept anew:"
)
_TOLERANCES_DECIDE = (
    "In {} directions the data leave at least half of the tolerances: a value that has its tolerance as its error was "
    "not measured."
)


@dataclass(frozen=True)
class CalibratedNumber:
    """A number of the drawing as the data have it."""

    key: str  # Key path in the file
    also: tuple[str, ...]  # Key paths of what moved with it
    drawn: float
    value: float
    sd: float  # Of the value, after the data
    tolerance: float  # Standard deviation before the data
    unit: str  # Of all four; empty of a pure number, and of the factor of a curve

    @property
    def texts(self) -> tuple[str, str, str, str]:
        """A row of the printed table."""
        places = max(0, 1 - math.floor(math.log10(self.sd))) if self.sd > 0.0 else 6
        return (
            self.key,
            f"{self.drawn:g} {self.unit}".rstrip(),
            f"{self.value:.{places}f} ± {self.sd:.{places}f} {self.unit}".rstrip(),
            f"{self.tolerance:.2g} {self.unit}".rstrip(),
        )


@dataclass(frozen=True, eq=False, repr=False)
class CalibrationResult(Printed):
    """A drawing calibrated on measurements; printed, it is what ``femfit calibrate`` prints.

    Parameters
    ----------
    drawing : str
        The text of the calibrated drawing: that of the old one with other numbers.
    table : SweepTable
        Its sweep.
    model : ActuatorModel
        What was fitted to that, with the effects beside the numbers.
    model_as_drawn : ActuatorModel
        The same of the drawing as it was, without effects.
    numbers : tuple of CalibratedNumber
        With standard deviations; ``covariance`` is theirs, in their units and order.
    beside : tuple of AddedEffect
        Effects that are no numbers of the drawing, fitted together with them.
    unseen : ErrorFall or None
        Per channel the error of the drawing as it was, and of the calibrated one on runs that were not fitted, each in
        turn; None where there is one run alone.
    fitted : ErrorFall
        The same on the readings that were fitted, of the calibrated drawing as swept, without any slope.
    undetermined : tuple of Combination
        What the data know hardly better than the tolerances do.
    lack_of_fit : LackOfFit
        Of the calibrated drawing with the effects beside it.
    beyond_noise : mapping of str to float
        Channels whose error on the readings fitted is more than 1.2 times what declared noise, or repeats, show, in
        times the noise.
    sweeps : int
        How often the drawing was swept; ``settled`` says whether the last step was small against the errors.

    Examples
    --------
    >>> import femfit as ff
    >>> found = ff.calibrate("rig.toml", "bench.csv", "runs/rig", numbers="hall.z_mm", effects=["core_saturation"])
    >>> [one.key for one in found.numbers]
    ['hall.z_mm']
    """

    drawing: str
    table: SweepTable
    model: ActuatorModel
    model_as_drawn: ActuatorModel
    numbers: tuple[CalibratedNumber, ...]
    covariance: FloatArray
    beside: tuple[AddedEffect, ...]
    unseen: ErrorFall | None
    fitted: ErrorFall
    undetermined: tuple[Combination, ...]
    lack_of_fit: LackOfFit
    beyond_noise: Mapping[str, float]
    sweeps: int
    settled: bool
    remarks: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()

    @property
    def correlation(self) -> FloatArray:
        """Of the errors of the numbers, shape (n, n)."""
        sd = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(sd, sd))

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data, without drawing, table and models."""
        return {
            "numbers": [vars(one) for one in self.numbers],
            "covariance": self.covariance.tolist(),
            "correlation": self.correlation.tolist(),
            "undetermined": [vars(one) for one in self.undetermined],
            "beside": [
                {"name": one.effect.name, "parameters": dict(one.parameters), "ci95": dict(one.ci95), "runs": one.runs}
                for one in self.beside
            ],
            "error_on_runs_left_out": self.unseen and self.unseen.to_dict(),
            "error_on_readings_fitted": self.fitted.to_dict(),
            "lack_of_fit": vars(self.lack_of_fit),
            "beyond_noise": dict(self.beyond_noise),
            "sweeps": self.sweeps,
            "settled": self.settled,
            "remarks": list(self.remarks),
            "findings": [one.as_dict() for one in self.findings],
        }

    def __str__(self) -> str:
        lines = [*suspicions(self.findings), self._verdict(), *self._table()]
        lines += [f"Fitted beside, not in the drawing: {words}." for words in self._beside()]
        lines += self.remarks
        lines += self._open()
        lines += alike([one.key for one in self.numbers], self.correlation)
        lines += [
            f"{one.key} is {abs(one.value - one.drawn) / one.tolerance:.1f} tolerances from its drawn value, which is "
            "unusual. Measure it on the device."
            for one in self.numbers
            if abs(one.value - one.drawn) > UNUSUAL * one.tolerance
        ]
        return "\n".join([*lines, *self._errors(), *notes(self.findings)])

    def _verdict(self) -> str:
        done = f"Calibrated {counted(len(self.numbers), 'number')} of the drawing in {counted(self.sweeps, 'sweep')}"
        if not self.settled:
            done = f"Not settled after {counted(self.sweeps, 'sweep')}: do not trust these numbers. Calibrate fewer"
        p = probability(self.lack_of_fit.p_value)
        if self.lack_of_fit.p_value > LEVEL_AFTER:
            left = in_words(self.beyond_noise, {one.channel: one.rms_after for one in self.fitted.channels})
            if left:
                missed = " and ".join(left.values())
                return f"{done}: the test finds nothing in what is left ({p}), but the model misses {missed}."
            return f"{done}: what is left is noise ({p})."
        return (
            f"{done}, but the misfit that is left is not noise ({p}): something else is wrong as well, and these "
            "numbers may stand for it. Diagnose with the new model."
        )

    def _table(self) -> list[str]:
        rows = [("number", "drawn", "calibrated", "tolerance"), *(one.texts for one in self.numbers)]
        widths = [max(len(row[k]) for row in rows) for k in range(4)]
        return ["  " + "  ".join(text.ljust(w) for text, w in zip(row, widths, strict=True)).rstrip() for row in rows]

    def _open(self) -> list[str]:
        units, count, left = {one.key: one.unit for one in self.numbers}, len(self.numbers), len(self.undetermined)
        if left <= SHOWN:
            return [one.in_words(units) for one in self.undetermined]
        some = counted(count - left, "combination")
        return [f"These data determine {some} of the {count} numbers. {_TOLERANCES_DECIDE.format(left)}"]

    def _beside(self) -> list[str]:
        nominal = nominal_of(self.model.without_effects)
        return [
            f"{one.effect.name}: {'; '.join(describe(one, nominal) or [one.effect.symptom.rstrip('.')])}"
            for one in self.beside
        ]

    def _errors(self) -> list[str]:
        swept = _errors(self.fitted)
        if self.unseen is None:
            return [
                _NOTHING_UNSEEN,
                *str(self.fitted).split("\n"),
            ]
        return [
            "As drawn, and calibrated without each run in turn:",
            *str(self.unseen).split("\n"),
            f"The calibrated drawing, swept anew, misses all readings by {swept}.",
        ]


def heading(result: CalibrationResult, drawing: str, data: Sequence[str]) -> str:
    """The comment above a calibrated drawing: what it was made from, and which numbers are not as drawn."""
    rows = (f"#   {key} = {value} (drawn {drawn})" for key, drawn, value, _ in (one.texts for one in result.numbers))
    end = "\r\n" if "\r\n" in result.drawing else "\n"
    lines = [f"# Calibrated by femfit from {drawing} and {', '.join(data)}:", *rows, "", ""]
    return end.join(lines).replace("±", "+-")


def _errors(fall: ErrorFall) -> str:
    """The errors after, in words."""
    shown: Mapping[str, str] = {
        one.channel: amount(one.rms_after, one.channel, 3)
        + ("" if one.after_over_noise is None else f" ({one.after_over_noise:.3g} times the noise)")
        for one in fall.channels
    }
    return ", ".join(f"{CHANNEL_WORDS[name]} {text}" for name, text in shown.items()) + " rms"
