"""How far apart two effects, or combinations of effects, are on given settings: one judge for advice and plans.

What effects leave of readings is what their best refit leaves, within their bounds and with their nonlinear parameters
free, in standard deviations of the noise. Readings of one explanation without noise, refitted by the other, give the
distance between the two: the T-criterion of a discriminating design. By a direct reading of an effect's parameters (a
shunt, a weight, a micrometer) they are as far apart as what they say of it, over its uncertainty and theirs. The noise
of a measurement that nobody has made yet is as estimated or declared, or as assumed.

References
----------
A. C. Atkinson and V. V. Fedorov, Biometrika 62 (1975) 57: T-optimal designs.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from scipy import stats

from femfit.core.numerics import ROUNDING, FloatArray
from femfit.effects.conditions import Nominal
from femfit.effects.effect import AddedEffect, Calibration, Effect
from femfit.identify.constants import PRIOR_MOUNT_M, PRIOR_RUN
from femfit.identify.decision.constants import (
    ALMOST_SURELY,
    GUESSED_NOISE,
    LARGEST_BENDING,
    NONLINEAR_PRICE,
    TIE,
    VARIANTS,
)
from femfit.identify.noise.whitening import NoiseModel, Whitening
from femfit.identify.observations import Observations
from femfit.identify.refit import Refit, Start, fitted_together, refit
from femfit.identify.signatures import columns_at, effect_columns
from femfit.tables.circuit_columns import parts_of


def needed_distance(tie: float = TIE) -> float:
    """Distance from which a diagnosis leaves the wrong one of two explanations out, in 19 of 20 campaigns.

    The weighted sums of squares differ by delta^2 with a standard deviation of 2 delta; they must differ by the tie of
    the decision, and by what the right explanation pays for its further parameters.
    """
    return float(ALMOST_SURELY + np.sqrt(ALMOST_SURELY**2 + tie))


def separation(
    whitening: Whitening, change: FloatArray, rivals: Sequence[Sequence[Start]], more_parameters: float = 0.0
) -> float | None:
    """How far the best refit of rivals stays from what an explanation changes; None where that is less than needed.

    The change has the shape (M,) and the readings' units.
    """
    needed = needed_distance(TIE + max(more_parameters, 0.0) * np.log(len(change)))
    whitening = whitening.with_values(whitening.observations.base + change)
    target = whitening.residual
    total = float(target @ target)
    least, begun = total, None
    for starts in rivals:
        fitted, fall = fitted_together(target, starts)
        if begun is None or total - fall < least:
            least, begun = total - fall, fitted
    least = max(least, 0.0)
    # No refit where the first order leaves less than needed already, nor where no nonlinear parameter makes up for it
    if begun is not None and np.sqrt(least) >= needed and least <= LARGEST_BENDING**2 * total:
        least = max(min(refit(whitening, begun).chi2, least), 0.0)
    apart = float(np.sqrt(least))
    return None if apart < needed * (1.0 - ROUNDING) else apart


def parameters_of(effects: Sequence[AddedEffect]) -> float:
    """Number of parameters off their nulls, as the decision counts them."""
    return sum(
        NONLINEAR_PRICE if p.nonlinear else float(added.parameters[p.name] != p.null)
        for added in effects
        for p in added.effect.parameters
    )


def starting_points(
    effects: Sequence[Effect], whitening: Whitening, fitted: Sequence[AddedEffect] = ()
) -> list[list[Start]]:
    """Where refits of effects begin: at trial nonlinear parameters, and where they were fitted before."""
    observations, variants = whitening.observations, list[Sequence[Start]]()
    for k, effect in enumerate(effects):
        columns = effect_columns(effect, observations)
        if fitted:
            columns = [*columns_at(fitted[k], observations), *columns]
        if columns:
            variants.append(Start.at_null(columns, whitening))
    return [list(starts) for starts, _ in zip(product(*variants), range(VARIANTS), strict=False)] if variants else []


def pair_clauses(pairs: Iterable[Sequence[str]]) -> list[tuple[str, list[str]]]:
    """Pairs in as few clauses as say them: a name, and those that it stands with."""
    remaining, clauses = [pair[:2] for pair in pairs], []
    while remaining:
        names = [name for pair in remaining for name in pair]
        name = max(dict.fromkeys(names), key=names.count)
        clauses.append((name, [a if b == name else b for a, b in remaining if name in {a, b}]))
        remaining = [pair for pair in remaining if name not in pair]
    return clauses


def apart_by_direct_reading(effect: str, calibration: Calibration, a: Refit, b: Refit) -> float:
    """What two explanations say of a direct reading, over its uncertainty and theirs."""
    uncertainty = np.array(list(calibration.reads.values()))
    readings = [direct_reading(effect, calibration, fit.effects) for fit in (a, b)]
    errors = [standard_errors(effect, calibration, fit.effects) for fit in (a, b)]
    return float(
        np.linalg.norm((readings[0] - readings[1]) / np.sqrt(uncertainty**2 + errors[0] ** 2 + errors[1] ** 2))
    )


def direct_reading(effect: str, calibration: Calibration, effects: Iterable[AddedEffect]) -> FloatArray:
    """What a direct reading of an effect's parameters shows where some effects act, in the parameters' units."""
    values = np.zeros(len(calibration.reads))
    for added in effects:
        if added.effect.name == effect:
            values += [added.parameters[name] for name in calibration.reads]
        for name, change in calibration.also.get(added.effect.name, {}).items():
            values[0] += change * added.parameters[name]
    return values


def standard_errors(effect: str, calibration: Calibration, effects: Iterable[AddedEffect]) -> FloatArray:
    """How well the fit of some effects knows the parameters that a direct reading reads; 0 where none has them."""
    for added in effects:
        if added.effect.name == effect:
            limits = [added.ci95.get(name, (0.0, 0.0)) for name in calibration.reads]
            return np.asarray(np.ptp(limits, axis=1) / (2.0 * stats.norm.isf(0.025)))
    return np.zeros(len(calibration.reads))


def planned_noise(observations: Observations) -> NoiseModel:
    """The noise model of a plan: declared noise, and the priors of mounts and runs that estimates start from."""
    channels, declared = observations.channels, observations.declared_noise
    sigma = np.array([declared.get(name, assumed_noise(name, observations.nominal)) for name in channels])
    zeros, many = np.zeros(len(channels)), np.full(len(channels), np.inf)
    source = {name: "declared" if name in declared else "assumed" for name in channels}
    run = PRIOR_RUN * sigma
    return NoiseModel(channels, sigma, zeros, PRIOR_MOUNT_M, run, many, many, source, PRIOR_MOUNT_M, run)


def noise_for(noise: NoiseModel, observations: Observations) -> NoiseModel:
    """An estimated noise model, with what is assumed for channels that were never measured."""
    assumed = planned_noise(replace(observations, declared_noise={}))
    test_run = np.where(noise.test_run > 0.0, noise.test_run, PRIOR_RUN * noise.sigma)
    numbers = {name: k for k, name in enumerate(noise.channels)}
    measured = np.array([name in numbers for name in observations.channels])
    place = [numbers.get(name, 0) for name in observations.channels]

    def filled(values: FloatArray, missing: FloatArray) -> FloatArray:
        return np.where(measured, values[place], missing)

    return replace(
        noise,
        channels=observations.channels,
        sigma=filled(noise.sigma, assumed.sigma),
        rho=filled(noise.rho, assumed.rho),
        run=filled(noise.run, assumed.run),
        repeats=filled(noise.repeats, assumed.repeats),
        degrees_of_freedom=filled(noise.degrees_of_freedom, assumed.degrees_of_freedom),
        mount_m=noise.mount_m or PRIOR_MOUNT_M,
        test_mount_m=noise.test_mount_m or PRIOR_MOUNT_M,
        test_run=filled(test_run, assumed.run),
    )


def assumed_noise(channel: str, nominal: Nominal) -> float:
    """The noise of a channel that was never measured, by its largest reading in the validity domain."""
    largest = {
        "force_N": nominal.force_N,
        "flux_linkage_Wb": nominal.flux_linkage_Wb,
        "hall_V": nominal.hall_swing_V,
        "voltage_V": nominal.resistance_ohm * nominal.peak_current_A,
        "inductance_H": nominal.inductance_H,
        "resistance_ohm": nominal.resistance_ohm,
    }
    return GUESSED_NOISE * largest[parts_of(channel)[0]]
