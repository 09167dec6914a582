"""A drawing with given values of its numbers: written, swept, fitted, and beside the readings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import TableError
from femfit.device.drawn_numbers import numbers_from_toml
from femfit.device.load import actuator_from_toml
from femfit.device.rewrite import rewritten
from femfit.effects.effect import AddedEffect, Effect
from femfit.field.sweep import run_sweep
from femfit.fit.build import fit_model
from femfit.identify.calibration.suspects import Suspect
from femfit.identify.noise.whitening import Whitening
from femfit.identify.readings.place import placed
from femfit.identify.refit.add_effects import in_their_runs, whitening_beside
from femfit.identify.refit.refit import Refit, refit
from femfit.identify.refit.start import Start, starting_point
from femfit.identify.signatures.columns import why_untestable
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.measurement import Measurement
from femfit.tables.sweep_table import SweepTable

Runs = Mapping[str, tuple[int, int]]


@dataclass(frozen=True)
class Drawing:
    """An actuator file's text, with what a sweep of it needs."""

    text: str
    source: str
    directory: Path  # Further files are named relative to it
    workers: int

    def with_values(self, numbers: Sequence[Suspect], values: FloatArray) -> str:
        """The text with other values of numbers."""
        new = [one.at(float(value)) for one, value in zip(numbers, values, strict=True)]
        return rewritten(self.text, new, self.source, self.directory)

    def swept(self, text: str, directory: Path, measured: Measurement) -> "Redrawn":
        """A text of this drawing swept with its signatures, and its model beside readings."""
        numbers = numbers_from_toml(text, self.source, self.directory)
        actuator = actuator_from_toml(text, self.source, self.directory)
        table = run_sweep(actuator, directory, workers=self.workers, signatures=numbers)
        model = fit_model(table).model
        if not model.drawn:
            raise TableError(
                "The model of this drawing takes up no numbers of it: it has several circuits, or its sweep is too "
                "small for a co-energy. Sweep more distances and currents."
            )
        return Redrawn(text, table, model, whitening_beside(placed(model, measured)))


@dataclass(frozen=True, eq=False)
class Redrawn:
    """A drawing that was swept, with its model beside the readings and nothing added to it."""

    text: str
    table: SweepTable
    model: ActuatorModel
    whitening: Whitening


@dataclass(frozen=True, eq=False)
class Prior:
    """What the tolerances say of the numbers, in the units of the effects' amplitudes and about present values."""

    mean: Mapping[str, float]
    sd: Mapping[str, float]

    @classmethod
    def of(cls, numbers: Sequence[Suspect], values: FloatArray) -> "Prior":
        """The prior where the drawing has these values."""
        pairs = [(one, float(value)) for one, value in zip(numbers, values, strict=True)]
        return cls(
            {one.effect: (one.drawn - value) / one.per(value) for one, value in pairs},
            {one.effect: one.tolerance / one.per(value) for one, value in pairs},
        )


@dataclass(frozen=True, eq=False)
class Estimate:
    """The numbers fitted by their slopes about a drawing that was swept, with the effects beside them."""

    fit: Refit
    change: FloatArray  # Of the numbers from that drawing, in their units; shape (n,)
    covariance: FloatArray  # Of the numbers, in their units; shape (n, n)
    alone: tuple[AddedEffect, ...]  # The effects beside a drawing without that change
    prior: Prior

    @property
    def information(self) -> FloatArray:
        """Inverse of the covariance, shape (n, n)."""
        size = np.outer(self.sd, self.sd)
        return np.asarray(np.linalg.pinv(self.covariance / size, hermitian=True) / size)

    @property
    def sd(self) -> FloatArray:
        """Standard deviations of the numbers, shape (n,)."""
        return np.sqrt(np.diag(self.covariance))


def estimate(
    redrawn: Redrawn, numbers: Sequence[Suspect], values: FloatArray, beside: Sequence[Effect], runs: Runs
) -> Estimate:
    """Fit the numbers within their priors, and the effects beside them, about the drawing as it was swept."""
    whitening, n = redrawn.whitening, len(numbers)
    observations, prior = whitening.observations, Prior.of(numbers, values)
    effects = [*(one.effect_of(redrawn.model) for one in numbers), *beside]
    for effect in effects:
        if reason := why_untestable(effect, observations):
            raise TableError(f"{effect.name} cannot be fitted to these data: {reason}. {effect.experiment}")
    # At the drawing: of numbers that cannot be told apart the best without their priors may be anywhere
    start = [
        one.at_null(one.columns, whitening) if k < n else one
        for k, one in enumerate(starting_point(observations, whitening, effects))
    ]
    start = in_their_runs(start, whitening, runs)
    fit = refit(observations, whitening, start, prior_sd=prior.sd, prior_mean=prior.mean)
    per = np.array([one.per(float(value)) for one, value in zip(numbers, values, strict=True)])
    place = [next(j for j, (k, _) in enumerate(fit.free) if k == number) for number in range(n)]
    change = per * np.array([fit.effects[k].parameters[fit.free[j][1].name] for k, j in enumerate(place)])
    size = per * np.array([fit.free[j][1].width for j in place])
    active = fit.active.copy()
    active[place] = False  # a step ends at ten tolerances, and the next one goes on
    covariance = replace(fit, active=active).covariance[np.ix_(place, place)] * np.outer(size, size)
    return Estimate(fit, change, covariance, _alone(whitening, fit, start[n:]), prior)


def _alone(whitening: Whitening, fit: Refit, start: Sequence[Start]) -> tuple[AddedEffect, ...]:
    """The effects beside the numbers, fitted without them, each with the width of its interval beside them."""
    if not start:
        return ()
    together = fit.effects[-len(start) :]
    begin = [one.continued(added) for one, added in zip(start, together, strict=True)]
    alone = refit(whitening.observations, whitening, begin).effects
    return tuple(_wide(one, other) for one, other in zip(alone, together, strict=True))


def _wide(alone: AddedEffect, together: AddedEffect) -> AddedEffect:
    interval = {}
    for name, (low, high) in together.ci95.items():
        half = 0.5 * (high - low)
        interval[name] = (alone.parameters[name] - half, alone.parameters[name] + half)
    return AddedEffect(alone.effect, alone.parameters, interval, alone.runs)
