"""Calibrates a drawing: its wrong numbers by Gauss and Newton, the field solved anew at every step.

At each step the drawing is swept with its signatures and fitted. The numbers, within the priors of their tolerances,
and the effects beside them are fitted by these slopes to all readings, and the drawing is written with what they say.
It ends where the step is small against the standard errors, so that no slope is left in the result: what is written is
what was swept. What the calibrated drawing leaves is diagnosed again: a cause that was hidden behind a large one shows.

References
----------
J. Nocedal and S. J. Wright, Numerical Optimization (Springer, 2006), section 10.3: Gauss-Newton.
A. Tarantola, Inverse Problem Theory (SIAM, 2005), section 3.2: least squares with Gaussian priors.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import ActuatorFileError, TableError
from femfit.core.paths import path_of
from femfit.device.rewrite import drawing_text
from femfit.effects.catalogue import effect_by_name
from femfit.identify.calibration.choose import Choice, first_choice, next_choice
from femfit.identify.calibration.constants import HALVINGS, MOST_ROUNDS, MOST_STEPS, SETTLED, SLOW
from femfit.identify.calibration.open_directions import open_combinations
from femfit.identify.calibration.redraw import Drawing, Estimate, Redrawn, estimate
from femfit.identify.calibration.remaining import decide_beside
from femfit.identify.calibration.result import CalibratedNumber, CalibrationResult
from femfit.identify.calibration.suspects import ALL, Suspect, suspects, wanted_suspects
from femfit.identify.comparison.fall import ErrorFall, error_fall
from femfit.identify.comparison.lack_of_fit import pattern_space
from femfit.identify.decision.campaign import guessed_noises
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.noise.within import beyond_noise
from femfit.identify.readings.place import measurement_of
from femfit.identify.refit.unseen import channel_rms, unseen_error
from femfit.identify.signatures.columns import effect_columns, why_untestable
from femfit.model.with_effects import with_effects
from femfit.tables.joined import joined_measurements
from femfit.tables.measurement import BenchTable, Measurement, TimeSeries

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
        Key paths of the numbers, as the signatures name them, or ``all``; None for those that a diagnosis names.
    effects : str, sequence of str, or None
        Effects of the catalogue that are fitted beside them; None for those that a diagnosis names.
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
    >>> found = ff.calibrate("rig.toml", "bench.csv", "runs/rig", numbers="hall.z_mm", effects=["core_saturation"])
    >>> number = found.numbers[0]
    >>> number.drawn, number.unit, number.sd < number.tolerance
    (0.0, 'mm', True)
    >>> changed = found.drawing  # the text of the new drawing, ready to be written
    """
    say = progress or (lambda _: None)
    say("Reading")
    path, directory = path_of(drawing, "An actuator file"), path_of(directory, "The directory of the sweeps")
    source = Drawing(drawing_text(path), str(path), path.parent, workers)
    known = suspects(source.text, source.source, source.directory)
    wanted = None if numbers is None else wanted_suspects(numbers, known)
    names = (effects,) if isinstance(effects, str) else effects
    beside = None if names is None else tuple(effect_by_name(name) for name in names)
    given = [data] if isinstance(data, str | Path | BenchTable | TimeSeries) else list(data)
    measured = joined_measurements([measurement_of(one) for one in given])
    say("Sweeping the drawing with its signatures")
    first = source.swept(source.text, directory / "drawn", measured)
    if wanted is None:
        say("Diagnosing")
        choice = first_choice(diagnose(first.model, measured, bootstrap=0), known, measured)
    else:
        everything = ALL in ([numbers] if isinstance(numbers, str) else list(numbers or ()))
        choice = Choice(tuple(one for one in wanted if not everything or _seen(one, first)))
        if not choice.numbers:
            raise TableError("These data show no number of the drawing: none of them changes any of the readings.")
    if beside is not None:
        choice = replace(choice, beside=tuple(effect.name for effect in beside), runs={})
    task = _Task(source, measured, directory / "calibrated", say)
    now = _at(first, choice, np.array([one.drawn for one in choice.numbers]))
    now = task.settled(now) if beside is not None else task.completed(now, known, asked=wanted is not None)
    say("Leaving each run out")
    return _result(first, now)


def _seen(number: Suspect, first: Redrawn) -> bool:
    """Whether a number changes any of the readings."""
    if number.effect == number.key and all(one.key != number.key for one in first.model.drawn):
        return False
    effect, observations = number.effect_of(first.model), first.whitening.observations
    return not why_untestable(effect, observations) and bool(effect_columns(effect, observations))


@dataclass(frozen=True, eq=False)
class _Iteration:
    """The drawing at present values of its numbers, and what the data say about them there."""

    redrawn: Redrawn
    choice: Choice
    values: FloatArray
    estimate: Estimate
    sweeps: int = 1

    @property
    def step(self) -> float:
        """Length of the change in standard deviations, of well determined combinations too, root mean square."""
        one = self.estimate
        return float(np.sqrt(one.change @ one.information @ one.change / len(one.change)))


def _at(redrawn: Redrawn, choice: Choice, values: FloatArray) -> _Iteration:
    effects = [effect_by_name(name) for name in choice.beside]
    return _Iteration(redrawn, choice, values, estimate(redrawn, choice.numbers, values, effects, choice.runs))


def _without_absent(now: _Iteration) -> _Iteration:
    """Without effects that were named beside earlier values of the numbers and are absent beside the present ones."""
    absent = [
        one.effect.name
        for one in now.estimate.alone
        if all(
            one.parameters[p.name] == p.null or (p.name in one.ci95 and _holds(one.ci95[p.name], p.null))
            for p in one.effect.amplitudes
        )
    ]
    if not absent:
        return now
    return replace(_at(now.redrawn, now.choice.without(absent), now.values), sweeps=now.sweeps)


def _holds(interval: tuple[float, float], value: float) -> bool:
    return interval[0] <= value <= interval[1]


@dataclass(frozen=True)
class _Task:
    """The drawing and the data."""

    source: Drawing
    measured: Measurement
    directory: Path
    say: Callable[[str], None]

    def settled(self, now: _Iteration, most: int = MOST_STEPS) -> _Iteration:
        """The drawing swept anew until a step is small against the errors; once at least."""
        part = 1.0
        for _ in range(most):
            if now.sweeps > 1 and now.step <= SETTLED:
                break
            self.say(f"Sweeping the drawing anew, step {now.sweeps}")
            text, values = _moved(self.source, now, part)
            redrawn = self.source.swept(text, self.directory, self.measured)
            before, now = now, replace(_at(redrawn, now.choice, values), sweeps=now.sweeps + 1)
            back = now.estimate.change @ now.estimate.information @ before.estimate.change < 0.0
            part *= 0.5 if back and now.step > SLOW * before.step else 1.0
        return now

    def completed(self, now: _Iteration, known: Sequence[Suspect], *, asked: bool) -> _Iteration:
        """The same with what is missing beside it, as a diagnosis with the numbers free names it after each step."""
        for _ in range(MOST_ROUNDS):
            now = _without_absent(self.settled(now, 1))
            self.say("Diagnosing what is left")
            decision = decide_beside(now.redrawn, now.estimate, self.measured)
            further = next_choice(now.choice, decision, known, asked=asked) if decision else now.choice
            nothing = (further.numbers, further.beside) == (now.choice.numbers, now.choice.beside)
            values = np.append(now.values, [one.drawn for one in further.numbers[len(now.values) :]])
            now = replace(_at(now.redrawn, further, values), sweeps=now.sweeps)
            if nothing:
                break
        return self.settled(_without_absent(self.settled(now)))


def _result(first: Redrawn, now: _Iteration) -> CalibrationResult:
    whitening, fit, choice = now.redrawn.whitening, now.estimate.fit, now.choice
    observations, noise = whitening.observations, whitening.noise
    before = channel_rms(first.whitening.observations, first.whitening.observations.residual)
    after = observations.predict(now.estimate.alone)
    channels = error_fall(observations, observations.base, after, noise.known).channels
    fitted = ErrorFall(tuple(replace(one, rms_before=before[one.channel]) for one in channels))
    left = whitening.full(observations.value - after)
    last = observations.runs - 1
    stay = tuple(replace(one, runs=None) for one in now.estimate.alone if one.runs is None or one.runs[1] == last)
    return CalibrationResult(
        drawing=now.redrawn.text,
        table=now.redrawn.table,
        model=with_effects(now.redrawn.model, stay),
        model_as_drawn=first.model,
        numbers=tuple(
            CalibratedNumber(one.key, one.also, one.drawn, float(value), float(sd), one.tolerance, one.unit)
            for one, value, sd in zip(choice.numbers, now.values, now.estimate.sd, strict=True)
        ),
        covariance=now.estimate.covariance,
        beside=now.estimate.alone,
        unseen=_unseen(now, fitted) if observations.runs > 1 else None,
        fitted=fitted,
        undetermined=open_combinations(choice.numbers, now.estimate.covariance),
        lack_of_fit=pattern_space(observations, whitening).test(left, fit.jacobian[:, ~fit.active]),
        beyond_noise=beyond_noise(observations, noise, {one.channel: one.rms_after for one in channels}),
        sweeps=now.sweeps,
        settled=now.step <= SETTLED,
        remarks=choice.remarks,
        findings=(*observations.findings, *guessed_noises(noise)),
    )


def _moved(source: Drawing, now: _Iteration, part: float) -> tuple[str, FloatArray]:
    """The drawing after a part of a step; a shorter one where it cannot be built.

    Values are rounded to a hundredth of the error that each would have, were all others known.
    """
    places = 2 + np.ceil(0.5 * np.log10(np.diag(now.estimate.information))).astype(int)
    for halving in range(HALVINGS + 1):
        moved = now.values + part * now.estimate.change / 2**halving
        values = np.array([round(float(x), int(n)) for x, n in zip(moved, places, strict=True)])
        text = source.with_values(now.choice.numbers, values)
        try:
            suspects(text, source.source, source.directory)
        except ActuatorFileError:
            if halving == HALVINGS:
                raise
        else:
            break
    return text, values


def _unseen(now: _Iteration, fitted: ErrorFall) -> ErrorFall:
    """The error on each run with the numbers and effects fitted to the others, about the calibrated drawing."""
    fit, whitening = now.estimate.fit, now.redrawn.whitening
    start = [one.continued(added) for one, added in zip(fit.start, fit.effects, strict=True)]
    prior = now.estimate.prior
    error = unseen_error(whitening.observations, whitening.noise, start, None, prior.sd, prior.mean)
    return ErrorFall(tuple(replace(one, rms_after=error.rms[one.channel]) for one in fitted.channels))
