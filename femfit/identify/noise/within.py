"""Whether an error is within the noise, the one answer for everything that is printed."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy import stats

from femfit.core.amount import amount
from femfit.core.arrays import FloatArray
from femfit.identify.constants import LEVEL, WITHIN_NOISE
from femfit.identify.noise.whitening import NoiseModel, random_columns, setting_errors
from femfit.identify.readings.observations import Observations
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
    observations: Observations, noise: NoiseModel | None, rms: Mapping[str, float], left: Mapping[str, str]
) -> str:
    """What a "nothing is missing" rests on where re-mounts make the errors that are given in words as ``left``.

    Empty where they would not make them, and where the readings or a declaration say how large re-mounts are.
    """
    if noise is None or not left or not noise.mount_assumed:
        return ""
    with_mounts = noise_shown(observations, replace(noise, mount_assumed=False, mount_m=noise.test_mount_m))
    if any(rms[name] > with_mounts[noise.channels.index(name)] for name in left):
        return ""
    return (
        f"if each time that it is put back the body may stand {amount(noise.test_mount_m, 'mount_m')} elsewhere. That "
        f"is assumed, and would explain all that the model misses: {' and '.join(left.values())}. To know, declare "
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
    said = [f"the {amount(noise.test_mount_m, 'mount_m')} by which the distance may differ from {place} ({source})"]
    if noise.test_mount_m >= np.ptp(observations.column("distance_m")):
        said = [f"any error of the distance that differs from {place} (too few of them say how large it is)"]
    return " and ".join(
        said[: noise.mount_m > 0.0]
        + at_stops[: bool(made.any())]
        + [
            f"the {amount(offset, name)} by which every reading of the {CHANNEL_WORDS[name]} differs from run to run "
            f"({'declared' if name in observations.declared_run else f'estimated; declare run.{name} if it is less'})"
            for name, offset, sigma in zip(noise.channels, noise.run, noise.sigma, strict=True)
            if offset > sigma
        ]
    )
