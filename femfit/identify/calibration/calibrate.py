"""Calibrates a drawing: its wrong numbers by Gauss and Newton, the field solved anew at every step.

At each step the drawing is swept with its signatures and fitted. The numbers, within the priors of their tolerances,
and the effects beside them are fitted by these slopes to all readings, and the drawing is written with what they say.
It ends where a further step would be short against the standard errors and lower the misfit no more, so that no slope
is left in the result: what is written is what was swept. What the calibrated drawing leaves is diagnosed again: a cause
that was hidden behind a large one shows.

References
----------
J. Nocedal and S. J. Wright, Numerical Optimization (Springer, 2006), section 10.3: Gauss-Newton.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from femfit.core.errors import ActuatorFileError, TableError
from femfit.core.files import path_of
from femfit.core.numerics import FloatArray
from femfit.device.drawn_numbers import NumberFacts
from femfit.device.rewrite import drawing_text
from femfit.effects.catalogue import effect_by_name
from femfit.effects.words import titled, titles_of
from femfit.identify.bench import measurement_of
from femfit.identify.calibration.fit import Estimate, Redrawn, decide_beside, estimate, swept
from femfit.identify.calibration.numbers import Choice, Drawing, with_named
from femfit.identify.calibration.result import CalibrationResult
from femfit.identify.constants import CALIBRATION_SETTLED
from femfit.identify.decision.diagnose import Diagnosis, diagnose, said_of
from femfit.identify.words import sentence
from femfit.tables.measurement import BenchTable, Measurement, TimeSeries, joined_measurements

MOST_STEPS = 8
"""Numerical: numbers that have not settled after so many sweeps in a row follow no Gauss-Newton step."""

MOST_ROUNDS = 3
"""Numerical: how often what a calibrated drawing leaves is diagnosed again; each round needs a cause of its own."""

RISE = 1.0
"""Numerical: a step after which the weighted sum of squares is more than this larger is taken back and halved; less
changes no conclusion, and meshes differ."""

MOST_IN_VAIN = 2
"""Numerical: sweeps in a row that lower the weighted sum of squares by no more than that: what is left is of meshes."""

HALVINGS = 4
"""Numerical: a step that draws what cannot be built is halved so often."""

Data = Measurement | str | Path


def calibrate(
    drawing: str | Path,
    data: Data | Sequence[Data],
    directory: str | Path,
    *,
    numbers: str | Sequence[str] | None = None,
    effects: str | Sequence[str] | None = None,
    workers: int = 2,
    progress: Callable[[str], None] | None = None,
) -> CalibrationResult:
    """Find the wrong numbers of a drawing from measurements, write it anew and solve its field again.

    Parameters
    ----------
    drawing : str or Path
        Actuator file; its ``[tolerances]`` say how far numbers may be off.
    data : BenchTable or TimeSeries, a path, or a sequence of them
        What was measured; several of one kind count as further runs.
    directory : str or Path
        For the sweeps: ``drawn`` and ``calibrated`` in it. What was solved there already is not solved again.
    numbers : str, sequence of str, or None
        Numbers of the drawing by their key paths, by unique ends of these, or as a diagnosis names them, or all; by
        default those that a diagnosis names.
    effects : str, sequence of str, or None
        Effects of the catalogue that are fitted beside the numbers; by default those that a diagnosis names.
    workers : int
        Processes of this machine that solve.

    Raises
    ------
    ActuatorFileError
        If the drawing has any problem, or sweeps parameters.
    UsageError
        If there is no such number or effect.
    TableError
        If nothing of the drawing is named, the data cannot show a number, or they are too few.

    Examples
    --------
    >>> place, effects = "sensors.hall.z_mm", ["core_saturation"]
    >>> calibrated = ff.calibrate("rig.toml", "bench.csv", "runs/rig", numbers=place, effects=effects)
    >>> number = calibrated.numbers[0]
    >>> number.drawn, number.unit
    (0.0, 'mm')
    >>> changed = calibrated.drawing  # the text of the new drawing, ready to be written
    """
    say = progress or (lambda _: None)
    say("Reading")
    path, directory = path_of(drawing, "An actuator file"), path_of(directory, "The directory of the sweeps")
    source = Drawing(drawing_text(path), str(path), path.parent)
    suspects = source.suspects
    wanted = None if numbers is None else source.wanted(numbers)
    names = (effects,) if isinstance(effects, str) else effects
    beside = None if names is None else {effect_by_name(name).name: None for name in names}
    sources = [data] if isinstance(data, str | Path | BenchTable | TimeSeries) else list(data)
    measured = joined_measurements([measurement_of(entry) for entry in sources])
    say("Sweeping the drawing with its signatures")
    first = swept(source, directory / "drawn", measured, workers)
    if wanted is None:
        say("Diagnosing")
        choice = _diagnosed(diagnose(first.model, measured), suspects)
    else:  # of all, those that these readings show
        choice = Choice(tuple(n for n in wanted if wanted is not source.each or first.column(n) is not None))
        if not choice.numbers:
            raise TableError("These data show no number of the drawing: none of them changes any of the readings.")
    if beside is not None:
        choice = Choice(choice.numbers, beside, {k: s for k, s in choice.remarks.items() if k not in choice.beside})
    sweep = partial(swept, directory=directory / "calibrated", measured=measured, workers=workers)
    task = _Task(source, measured, sweep, say)
    now = estimate(first, choice, np.array([number.value for number in choice.numbers]))
    now = task.settled(now) if beside is not None else task.completed(now, asked=wanted is not None)
    say("Leaving each run out")
    return CalibrationResult.of(first, now)


def _diagnosed(diagnosis: Diagnosis, suspects: Sequence[NumberFacts]) -> Choice:
    """What the diagnosis of a drawing names; TableError where that is no number that it can have."""
    choice = with_named(Choice(), diagnosis, suspects)
    if choice.numbers:
        return choice
    titles = titles_of(diagnosis.observations.nominal.drawn)
    why = [*choice.remarks.values(), titled(said_of(diagnosis, "verdict"), titles)]
    if choice.beside:
        why.append(f"That is {' and '.join(choice.beside)} and no number; femfit add puts it into the model.")
    raise TableError(sentence("refusals", "no_number", why))


@dataclass(frozen=True)
class _Task:
    """The drawing and the data."""

    source: Drawing
    measured: Measurement
    swept: Callable[..., Redrawn]  # (drawing, sweeps), in the directory of the calibrated one
    say: Callable[[str], None]

    def settled(self, best: Estimate, most: int = MOST_STEPS) -> Estimate:
        """The drawing swept anew, once at least, until a step is short and lowers the misfit no more.

        Fields that are solved on other meshes differ: two sweeps in a row without a lower misfit end it as well.
        """
        share, good, in_vain, last = 1.0, 0, 0, best
        for _ in range(MOST_STEPS):
            if good == most or in_vain == MOST_IN_VAIN:
                break
            if last is best and best.redrawn.sweeps > 1 and best.step <= CALIBRATION_SETTLED and best.fall <= RISE:
                break
            self.say(f"Sweeping the drawing anew, step {last.redrawn.sweeps}")
            drawing, values = _moved(self.source, best, share)
            last = estimate(self.swept(drawing, sweeps=last.redrawn.sweeps + 1), best.choice, values)
            gain = best.cost(last) - last.cost(last)
            in_vain = 0 if gain > RISE else in_vain + 1
            if gain >= -RISE:
                best, share, good = last, min(1.0, 2.0 * share), good + 1
            else:
                share *= 0.5
        if last is not best:  # what lies in the directory is what is said
            again = self.swept(best.redrawn.drawing, sweeps=last.redrawn.sweeps + 1)
            best = estimate(again, best.choice, best.values)
        return best

    def completed(self, best: Estimate, *, asked: bool) -> Estimate:
        """The same with what is missing beside it, as a diagnosis with the numbers free names it after each step."""
        for _ in range(MOST_ROUNDS):
            best = self.settled(best, 1)
            self.say("Diagnosing what is left")
            decision, choice = decide_beside(best, self.measured), best.choice
            wider = with_named(choice, decision, self.source.suspects, asked=asked)
            drawn = [number.value for number in wider.numbers[len(best.values) :]]
            best = estimate(best.redrawn, wider, np.append(best.values, drawn))
            if (wider.numbers, wider.beside) == (choice.numbers, choice.beside):
                break
        return self.settled(best)


def _moved(source: Drawing, best: Estimate, share: float) -> tuple[Drawing, FloatArray]:
    """The drawing after a part of a step; a shorter one where it cannot be built.

    Values are rounded to a hundredth of the error that each would have, were all others known.
    """
    places = 2 + np.ceil(0.5 * np.log10(np.diag(best.information))).astype(int)
    for halving in range(HALVINGS + 1):
        moved = best.values + share * best.change / 2**halving
        values = np.array([round(float(x), int(n)) for x, n in zip(moved, places, strict=True)])
        drawing = source.with_values(best.choice.numbers, values)
        try:
            _ = drawing.numbers
        except ActuatorFileError:
            if halving == HALVINGS:
                raise
        else:
            break
    return drawing, values
