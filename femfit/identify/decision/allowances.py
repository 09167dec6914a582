"""What a verdict grants a model beside the noise of a reading: mounts, runs, stops, and the model's own misfit.

One answer, for everything that is printed, to whether an error is within the noise, what it may be taken for where it
is not, and what would make the model's own misfit to its table smaller.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy import stats

from femfit.core.numerics import FloatArray
from femfit.core.text import amount, rounded
from femfit.fit.misfit import to_be_added
from femfit.identify.constants import (
    LEVEL,
    WITHIN_NOISE,
)
from femfit.identify.decision.constants import OWN_MISFIT
from femfit.identify.noise.whitening import NoiseModel, random_columns, setting_errors
from femfit.identify.readings.observations import Observations
from femfit.model.actuator_model import ActuatorModel
from femfit.model.magnetics import LawMagnetics
from femfit.model.network_magnetics import NetworkMagnetics
from femfit.tables.measurement import CHANNEL_WORDS


def beyond_noise(observations: Observations, noise: NoiseModel | None, rms: Mapping[str, float]) -> dict[str, float]:
    """Channels whose rms error is more than their noise, and how many times the noise of one reading it is.

    Within the noise is what is at most 1.2 times what the declared noise, or repeats, show: of the readings, of
    settings, and of mounts and runs as far as the readings show these. What is assumed of them does not count, nor a
    guess of the noise. Few readings may have more: what chance makes of so many, at the level of the tests. A channel
    of unknown noise is in no list.
    """
    if noise is None:
        return {}
    shown, number = noise_shown(observations, noise), {name: c for c, name in enumerate(noise.channels)}
    return {
        name: error / float(noise.sigma[number[name]])
        for name, error in rms.items()
        if name in noise.source and error > _most(int(np.sum(observations.of(name)))) * shown[number[name]]
    }


def _most(readings: int) -> float:
    """Rms error over the noise up to which so many readings are within it: few are far from 1 by chance."""
    return max(WITHIN_NOISE, float(np.sqrt(stats.chi2.isf(LEVEL, readings) / readings)))


def noise_shown(observations: Observations, noise: NoiseModel) -> FloatArray:
    """Rms error that the noise makes in each channel, by what was declared and what the readings show of it."""
    count = np.maximum(np.bincount(observations.channel, minlength=len(noise.sigma)), 1)
    columns, deviations = random_columns(observations, 0.0 if noise.mount_assumed else noise.mount_m, noise.run)
    settings = sum((size**2 for _, size in setting_errors(observations, noise.stop_m)), np.zeros(len(columns)))
    beside = np.bincount(observations.channel, settings + columns**2 @ deviations**2, len(noise.sigma)) / count
    return np.asarray(np.sqrt(noise.sigma**2 + beside))


def not_judged(observations: Observations, noise: NoiseModel | None) -> list[str]:
    """A sentence on the channels whose noise is unknown, beside others; none where there are none."""
    unknown = [CHANNEL_WORDS[name] for name in observations.channels if noise and name not in noise.source]
    if not unknown:
        return []
    return [
        f"Not judged: the {' and the '.join(unknown)}, whose noise nothing says. Measure settings twice, or declare it."
    ]


def if_mounts_are_assumed(
    observations: Observations, noise: NoiseModel | None, rms: Mapping[str, float], missed: Mapping[str, str]
) -> str:
    """What a "nothing is missing" rests on where re-mounts make the errors that are given in words as ``left``.

    Empty where they would not make them, and where the readings or a declaration say how large re-mounts are.
    """
    if noise is None or not missed or not noise.mount_assumed:
        return ""
    with_mounts = noise_shown(observations, replace(noise, mount_assumed=False, mount_m=noise.test_mount_m))
    if any(rms[name] > with_mounts[noise.channels.index(name)] for name in missed):
        return ""
    return (
        f"if each time that it is put back the body may stand {amount(noise.test_mount_m, 'mount_m')} elsewhere. That "
        f"is assumed, and would explain all that the model misses: {' and '.join(missed.values())}. To know, declare "
        "distance_mm, or put the body back more often."
    )


def in_words(observations: Observations, beyond: Mapping[str, float], rms: Mapping[str, float]) -> dict[str, str]:
    """Each such channel as it is said of a model: what it misses, and by how much."""
    return {
        name: f"the {CHANNEL_WORDS[name]} by {observations.amount(rms[name], name, 3)} rms, "
        f"{times:.3g} times the noise of one reading"
        for name, times in beyond.items()
    }


def allowed_for(observations: Observations, noise: NoiseModel | None) -> str:
    """What the test allows for beside the noise of a reading, and where that comes from; empty where that is nothing.

    Offsets of runs, and errors of stops, are said where they make more than the noise of one reading.
    """
    if noise is None:
        return ""
    made = np.abs(noise.stop_m * observations.distance_slope) > noise.sigma[observations.channel]
    at_stops = [f"the {amount(noise.stop_m, 'mount_m')} by which the distance is off at each stop (estimated)"]
    place = "mount to mount" if "mount" in observations.given else "run to run"
    source = "assumed, since there are few" if noise.mount_assumed else "estimated"
    mounts = [f"the {amount(noise.test_mount_m, 'mount_m')} by which the distance may differ from {place} ({source})"]
    if noise.test_mount_m >= np.ptp(observations.column("distance_m")):
        mounts = [f"any error of the distance that differs from {place} (too few of them say how large it is)"]
    return " and ".join(
        mounts[: noise.mount_m > 0.0]
        + at_stops[: bool(made.any())]
        + [
            f"the {amount(offset, name)} by which every reading of the {CHANNEL_WORDS[name]} differs from run to run "
            f"({'declared' if name in observations.declared_run else f'estimated; declare run.{name} if it is less'})"
            for name, offset, sigma in zip(noise.channels, noise.run, noise.sigma, strict=True)
            if offset > sigma
        ]
    )


_VERDICT = (
    "{nothing} is missing beyond the model's own misfit to the table that it was fitted to: it misses {both}. {share} "
    "Of its own misfit no more than the size is known, so an error of up to {most} times it, {hidden}, could hide "
    "behind it."
)
_AWAY = (
    "{nothing} is missing beyond what the model may miss by itself, since its eddy currents hold for other currents: "
    "it misses {both}. An error of up to {most} times that, {hidden}, could hide behind it."
)
_FINER = "To see smaller errors, make the model's own misfit smaller. "


def own_misfit_sentence(observations: Observations, times_own: float, apart: Mapping[str, str]) -> str:
    """The verdict where a model misses the readings no more than its own table by an assumed factor.

    Parameters
    ----------
    times_own : float
        Of :class:`~femfit.identify.decision.naming.Decision`.
    apart : mapping of str to str
        Channels whose error is more than noise and own misfit, as :func:`beyond_own_misfit` has them: they are said
        first, and granted nothing.
    """
    both, hidden, away, amount_of = [], [], observations.away_from_bias, observations.amount
    for name in granted_channels(observations, apart):
        here, words = observations.of(name), CHANNEL_WORDS[name]
        read, size = (float(np.sqrt(np.mean(x[here] ** 2))) for x in (observations.residual, observations.own_misfit))
        where = f"may miss {amount_of(size, name)}" if away else f"{amount_of(size, name)} in that table"
        both.append(f"the {words} by {amount_of(read, name)} rms in these readings and {where}")
        hidden.append(f"{amount_of(OWN_MISFIT * size, name)} rms of the {words}")
    missed = [f"No effect is named, but the model misses {' and '.join(apart.values())}."] if apart else []
    if not both:
        return " ".join(missed)
    granted = (_AWAY if away else _VERDICT).format(
        nothing="Apart from that, nothing" if apart else "Nothing",
        both=", ".join(both),
        share=f"Noise taken off, that is {rounded(times_own, 2)} times its own misfit."
        if times_own > 0.0
        else "Noise alone makes as much.",
        most=f"{OWN_MISFIT:g}",
        hidden=" or ".join(hidden),
    )
    return " ".join([*missed, granted])


def also_allowed(observations: Observations, beyond: Mapping[str, str]) -> str:
    """What lets a test pass that leaves channels beyond their noise: the model's own misfit there; empty for none."""
    most = own_misfit(observations)
    sizes = [
        f"{observations.amount(most[name] / OWN_MISFIT, name)} rms of the {CHANNEL_WORDS[name]}"
        for name in beyond
        if most[name]
    ]
    return f"the model's own misfit in any pattern, {' and '.join(sizes)}" if sizes else ""


def granted_channels(observations: Observations, apart: Mapping[str, str]) -> list[str]:
    """Channels whose error is taken for the model's own misfit, where that of those apart is not."""
    return [name for name, most in own_misfit(observations).items() if most > 0.0 and name not in apart]


def beyond_own_misfit(
    observations: Observations, beyond: Mapping[str, float], rms: Mapping[str, float]
) -> dict[str, str]:
    """Channels beyond the noise whose error the model's own misfit does not make either, in words."""
    most = own_misfit(observations)
    return in_words(observations, {name: times for name, times in beyond.items() if rms[name] > most[name]}, rms)


def own_misfit(observations: Observations) -> dict[str, float]:
    """Rms error per channel, in its unit, up to which it is taken for the model's own misfit to its table."""
    return {
        name: OWN_MISFIT * float(np.sqrt(np.mean(observations.own_misfit[observations.of(name)] ** 2)))
        for name in observations.channels
    }


def finer_model(model: ActuatorModel) -> str:
    """What to do about a model's own misfit: settings to add to the sweep, or the co-energy in place of a law."""
    if isinstance(model.without_effects.magnetics, LawMagnetics | NetworkMagnetics):
        return f"{_FINER}Fit the co-energy to the same table (femfit fit without --model) and diagnose with it."
    finer = (model.provenance.get("fit") or {}).get("finer_sweep")
    return _FINER + (to_be_added(finer) if finer else "Sweep at more distances and currents, and fit again.")
