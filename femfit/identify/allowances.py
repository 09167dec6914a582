"""What a verdict grants a model beside the noise of a reading: mounts, runs, stops, and the model's own misfit.

One answer, for everything that is printed, to whether an error is within the noise, what it may be taken for where it
is not, and what would make the model's own misfit to its table smaller. Its words stand in ``allowances.j2``.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy import stats

from femfit.core.numerics import FloatArray
from femfit.fit.misfit import to_be_added
from femfit.identify.constants import LEVEL, WITHIN_NOISE
from femfit.identify.decision.constants import OWN_MISFIT
from femfit.identify.noise.whitening import NoiseModel, random_columns, setting_errors
from femfit.identify.observations import Observations
from femfit.identify.words import sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.magnetics import LawMagnetics
from femfit.model.network_magnetics import NetworkMagnetics
from femfit.tables.measurement import OF_RUNS


@dataclass(frozen=True)
class Allowed:
    """Which errors are more than noise, and what the others may be taken for."""

    rms: Mapping[str, float]  # The errors that are judged, per channel in its unit
    magnitude: Mapping[str, float]  # Of impedances, as of the readings
    beyond: Mapping[str, float]  # As of :func:`beyond_noise`
    apart: tuple[str, ...]  # Those of them that the model's own misfit does not make either
    own: Mapping[str, float]  # Rms of the model's own misfit per channel
    away: bool  # Whether the model's eddy currents hold for other currents
    place: str  # From where to where the distance may differ
    unknown: tuple[str, ...] = ()  # Channels whose noise nothing says, beside others
    by_mounts: frozenset[str] = frozenset()  # Channels whose error assumed mounts would make
    mount: Literal["", "assumed", "estimated", "any"] = ""  # How it is known; empty where mounts have no freedom
    mount_m: float = 0.0
    stop_m: float = 0.0  # 0 where stops make less than the noise of one reading
    # Offsets of runs that are larger than the noise of one reading, and whether they were declared
    runs: Mapping[str, tuple[float, bool]] = field(default_factory=dict)

    @property
    def granted(self) -> tuple[str, ...]:
        """Channels of which the model misses its own table."""
        return tuple(name for name, size in self.own.items() if size > 0.0)

    def made_by_mounts(self, names: Collection[str]) -> bool:
        """Whether assumed mounts would make all of some errors."""
        return bool(names) and self.by_mounts.issuperset(names)


def allowed(observations: Observations, noise: NoiseModel | None, rms: Mapping[str, float]) -> Allowed:
    """What a verdict on errors grants."""
    own = observations.rms(observations.own_misfit)
    beyond = beyond_noise(observations, noise, rms)
    facts = Allowed(
        rms=rms,
        magnitude=observations.magnitude,
        beyond=beyond,
        apart=tuple(name for name in beyond if rms[name] > OWN_MISFIT * own[name]),
        own=own,
        away=observations.away_from_bias,
        place="mount to mount" if "mount" in observations.given else "run to run",
    )
    if noise is None:
        return facts
    by_mounts = frozenset[str]()
    if beyond and noise.mount_assumed:
        shown = noise_shown(observations, replace(noise, mount_assumed=False, mount_m=noise.test_mount_m))
        by_mounts = frozenset(name for name in beyond if rms[name] <= shown[noise.channels.index(name)])
    any_distance = noise.test_mount_m >= np.ptp(observations.column("distance_m"))
    source: Literal["assumed", "estimated"] = "assumed" if noise.mount_assumed else "estimated"
    made = np.abs(noise.stop_m * observations.distance_slope) > noise.sigma[observations.channel]
    return replace(
        facts,
        unknown=tuple(name for name in observations.channels if name not in noise.source),
        by_mounts=by_mounts,
        mount="" if not noise.mount_m > 0.0 else "any" if any_distance else source,
        mount_m=noise.test_mount_m,
        stop_m=noise.stop_m if made.any() else 0.0,
        runs={
            name: (float(offset), OF_RUNS + name in observations.declared_noise)
            for name, offset, sigma in zip(noise.channels, noise.run, noise.sigma, strict=True)
            if offset > sigma
        },
    )


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
        if name in noise.source
        and (n := int(np.sum(observations.of(name))))
        and error > max(WITHIN_NOISE, float(np.sqrt(stats.chi2.isf(LEVEL, n) / n))) * shown[number[name]]
    }


def noise_shown(observations: Observations, noise: NoiseModel) -> FloatArray:
    """Rms error that the noise makes in each channel, by what was declared and what the readings show of it."""
    columns, deviations = random_columns(observations, 0.0 if noise.mount_assumed else noise.mount_m, noise.run)
    settings = sum((size**2 for _, size in setting_errors(observations, noise.stop_m)), np.zeros(len(columns)))
    beside = observations.mean_square(np.sqrt(settings + columns**2 @ deviations**2))
    return np.asarray(np.sqrt(noise.sigma**2 + beside))


def finer_model(model: ActuatorModel) -> str:
    """What to do about a model's own misfit: settings to add to the sweep, or the co-energy in place of a law."""
    return sentence("allowances", "finer_model", finer_sweep(model))


def finer_sweep(model: ActuatorModel) -> str:
    """Settings to add to the sweep; ``law`` where a model is none of the co-energy, empty where none are known."""
    if isinstance(model.without_effects.magnetics, LawMagnetics | NetworkMagnetics):
        return "law"
    finer = (model.provenance.get("fit") or {}).get("finer_sweep")
    return to_be_added(finer) if finer else ""
