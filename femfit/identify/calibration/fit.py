"""The numbers of a drawing fitted to readings by their slopes, and what is missing beside them.

References
----------
A. Tarantola, Inverse Problem Theory (SIAM, 2005), section 3.2: least squares with Gaussian priors.
S. F. Schmidt, Advances in Control Systems 3 (1966) 293: parameters that are considered and not estimated.
B. D. Tapley, B. E. Schutz and G. H. Born, Statistical Orbit Determination (Elsevier, 2004), chapter 6: the same of
least squares.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from femfit.core.errors import TableError
from femfit.core.numerics import FloatArray
from femfit.core.results import Finding
from femfit.device.drawn_numbers import NumberFacts
from femfit.device.load import actuator_from_toml
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect, Effect
from femfit.field.sweep import run_sweep
from femfit.fit.build import fit_model
from femfit.identify.add_effects import in_their_runs, whitening_beside
from femfit.identify.bench import placed
from femfit.identify.calibration.numbers import Choice, Drawing
from femfit.identify.decision.campaign import considered_effects, gather
from femfit.identify.decision.naming import Decision, decide
from femfit.identify.noise.whitening import Whitening
from femfit.identify.refit import Refit, refit, starting_point
from femfit.identify.signatures import columns_at, testable_columns
from femfit.identify.words import sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.with_effects import with_effects
from femfit.tables.measurement import Measurement
from femfit.tables.sweep_table import SweepTable


@dataclass(frozen=True, eq=False)
class Redrawn:
    """A drawing that was swept, with its model beside the readings and nothing added to it."""

    drawing: Drawing
    table: SweepTable
    model: ActuatorModel
    whitening: Whitening
    sweeps: int = 1  # How many it took until here

    def effect_of(self, number: NumberFacts) -> Effect | None:
        """What a number changes of the model; None where that is nothing at the points of the sweep."""
        if number.effect:
            return effect_by_name(number.effect)
        return next((drawn.effect for drawn in self.model.drawn if drawn.key == number.key), None)

    def column(self, number: NumberFacts) -> FloatArray | None:
        """Change of the readings per unit of that effect, shape (M,); None where these show nothing."""
        effect = self.effect_of(number)
        variants, _ = testable_columns(self.whitening.observations, [effect] if effect else [])
        return variants[0].columns[:, 0] if variants else None


def swept(drawing: Drawing, directory: Path, measured: Measurement, workers: int, sweeps: int = 1) -> Redrawn:
    """A drawing swept with its signatures, and its model beside readings."""
    actuator = actuator_from_toml(drawing.text, drawing.source, drawing.directory)
    table = run_sweep(actuator, directory, workers=workers, signatures=drawing.numbers)
    model = fit_model(table).model
    if not model.drawn:
        raise TableError(sentence("refusals", "no_drawn_numbers"))
    return Redrawn(drawing, table, model, whitening_beside(placed(model, measured)), sweeps)


@dataclass(frozen=True, eq=False)
class Estimate:
    """The numbers fitted by their slopes about a drawing that was swept, with the effects beside them."""

    redrawn: Redrawn
    choice: Choice
    values: FloatArray  # Of the numbers in the drawing, shape (n,)
    fit: Refit  # The numbers' effects first
    beside: tuple[AddedEffect, ...]  # The effects beside, fitted to the drawing without a change of its numbers

    @cached_property
    def scale(self) -> FloatArray:
        """Each number's unit over those of the fit's free parameters, shape (n, p): zero but for its own."""
        result = np.zeros((len(self.values), len(self.fit.free)))
        for j, (k, parameter) in enumerate(self.fit.free):
            if k < len(self.values):
                result[k, j] = self.choice.numbers[k].per(self.values[k]) * parameter.width
        return result

    @cached_property
    def unbounded(self) -> Refit:
        """The fit with the numbers free: a step ends at ten tolerances, and the next one goes on."""
        return replace(self.fit, active=self.fit.active & ~self.scale.any(axis=0))

    @property
    def change(self) -> FloatArray:
        """Of the numbers from the drawing, in their units; shape (n,)."""
        return self.scale @ [self.fit.effects[k].parameters[p.name] / p.width for k, p in self.fit.free]

    @cached_property
    def covariance(self) -> FloatArray:
        """Of the numbers in their units, were all others as drawn; shape (n, n)."""
        return np.asarray(self.scale @ self.unbounded.covariance @ self.scale.T)

    @cached_property
    def information(self) -> FloatArray:
        """Its inverse."""
        return _inverse(self.covariance)

    @property
    def fall(self) -> float:
        """By how much the change should lower the weighted sum of squares, over what readings have where it is more."""
        return float(self.change @ self.information @ self.change)

    @property
    def step(self) -> float:
        """Length of the change in standard errors, of well determined combinations too, root mean square."""
        return float(np.sqrt(self.change @ _inverse(self.error) @ self.change / len(self.change)))

    def cost(self, like: "Estimate") -> float:
        """Weighted sum of squares that the drawing leaves, by the noise of another estimate, and of its tolerances."""
        observations = self.redrawn.whitening.observations
        white = like.redrawn.whitening.full(observations.value - observations.predict(self.beside))
        drawn = [
            (number.value - value) / number.deviation
            for number, value in zip(self.choice.numbers, self.values, strict=True)
        ]
        return float(white @ white) + float(np.sum(np.square(drawn)))

    @cached_property
    def error(self) -> FloatArray:
        """Covariance of the numbers where those that stay as drawn may be off within their tolerances, shape (n, n).

        With whitened columns J of all that was fitted, and S of the others per tolerance, the fitted ones move by
        -G c where the others are off by c tolerances, G = (J'J + L)^-1 J'S. Before the data c has the covariance 1:
        least squares then have the error P + G G', Schmidt's consider covariance. After them c has the inverse of
        S'S - S'J G + 1 about its estimate; its second moment about zero, the drawing, is C, and the error P + G C G'.
        """
        fitted = {*(number.name for number in self.choice.numbers), *self.choice.beside}
        unfitted = [
            suspect
            for suspect in self.redrawn.drawing.uncertain
            if suspect.name not in fitted
            and not suspect.is_contour
            and not any(map(suspect.overlaps, self.choice.numbers))
        ]
        columns = [(suspect.tolerance, self.redrawn.column(suspect)) for suspect in unfitted]
        off = [tolerance * column for tolerance, column in columns if column is not None]
        if not off:
            return self.covariance
        moving = ~self.unbounded.active
        fitted_to, others_by = -self.fit.jacobian[:, moving], self.redrawn.whitening.full(np.stack(off, axis=1))
        information = fitted_to.T @ fitted_to + np.diag(self.fit.precision[moving])
        moved = np.linalg.pinv(information, hermitian=True) @ fitted_to.T @ others_by
        about = np.linalg.inv(others_by.T @ (others_by - fitted_to @ moved) + np.eye(len(off)))
        moments = about @ others_by.T @ self.fit.whitened_residual
        by = self.scale[:, moving] @ moved
        return np.asarray(self.covariance + by @ (about + np.outer(moments, moments)) @ by.T)


def _inverse(covariance: FloatArray) -> FloatArray:
    """Of numbers in units of their own, which differ by powers of ten."""
    size = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    return np.asarray(np.linalg.pinv(covariance / size, hermitian=True) / size)


def estimate(redrawn: Redrawn, choice: Choice, values: FloatArray) -> Estimate:
    """Fit numbers within their tolerances, and the effects beside them, about the drawing as it was swept."""
    whitening, n = redrawn.whitening, len(choice.numbers)
    effects = []
    for number in choice.numbers:
        effect = redrawn.effect_of(number)
        if effect is None:
            raise TableError(sentence("refusals", "unseen_number", number.subject))
        effects.append(effect)
    effects += [effect_by_name(name) for name in choice.beside]
    # At the drawing: of numbers that cannot be told apart the best without their tolerances may be anywhere
    start = starting_point(whitening, effects)
    for k, (number, value) in enumerate(zip(choice.numbers, values.tolist(), strict=True)):
        per, none = number.per(value), np.zeros(start[k].count)
        mean, sd = (number.value - value) / per, number.deviation / per
        start[k] = replace(start[k], amplitude=none, prior_mean=mean, prior_sd=sd)
    start = in_their_runs(start, whitening, {name: runs for name, runs in choice.beside.items() if runs})
    fit = refit(whitening, start)
    alone = refit(whitening, fit.restart[n:]).effects if start[n:] else ()
    beside = tuple(replace(added, ci95=free.ci95) for added, free in zip(alone, fit.effects[n:], strict=True))
    return Estimate(redrawn, choice, values, fit, beside)


def decide_beside(best: Estimate, measured: Measurement) -> Decision:
    """The decision about what the calibrated drawing leaves.

    Had a cause been overlooked, the numbers would have been fitted to it as well, and what they leave of it would look
    like another. So what was fitted is free in this decision: its columns scatter as the noise does, each number by its
    tolerance and each effect by its plausible range.
    """
    observations = placed(with_effects(best.redrawn.model, best.beside), measured)
    fitted = best.fit.effects
    campaign = gather(observations, considered_effects(best.fit.names, observations.nominal))
    if isinstance(campaign, Finding):
        return Decision("compare_only")
    free = [
        columns.columns * [start.prior_sd if np.isfinite(start.prior_sd) else p.width for p in columns.amplitudes]
        for added, start in zip(fitted, best.fit.start, strict=True)
        for columns in columns_at(added, best.redrawn.whitening.observations)
    ]
    own_misfit = campaign.whitening.misfit
    misfit = np.concatenate([*([] if own_misfit is None else [own_misfit]), *free], axis=1)
    return decide(campaign.whitened_by(replace(campaign.whitening, misfit=misfit)))
