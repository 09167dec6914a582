"""How far a model is from measurements, against the noise floor, and where: ``femfit compare``."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from femfit.core.finding import Finding
from femfit.identify.comparison.compare_shape import ShapeMisfit, shape_misfit
from femfit.identify.comparison.gate import pattern_space
from femfit.identify.comparison.misfit_maps import MisfitMap, misfit_maps
from femfit.identify.comparison.patterns import smooth_patterns
from femfit.identify.comparison.where import where_it_fails
from femfit.identify.decision.diagnosis import Gate, Where
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.whitening import NoiseModel, Whitening, chains_of, orthonormal_basis
from femfit.identify.readings.observations import Observations, bench_observations
from femfit.identify.readings.repeats import lack_of_fit
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.measurement import BenchTable

LEVEL = 0.01
"""Probability of calling a model that holds a failing one."""

NO_FLOOR = Finding(
    "no-noise-floor",
    "info",
    "Neither repeated settings nor a declared noise say how large the noise is, so the misfit cannot be judged.",
    "Measure some settings twice, or declare the noise in a .toml beside the data ([noise] force_N = 2e-4).",
)

CompareVerdict = Literal["agrees", "fails", "wrong_shape", "compare_only"]

_OWN_MISFIT = 4.0
"""A structured misfit up to twice (in amplitude) the model's own to its sweep is that."""


@dataclass(frozen=True)
class Extreme:
    """The largest misfit of a channel.

    Parameters
    ----------
    value : float
        Recorded minus predicted, in the channel's unit.
    """

    value: float
    distance_m: float
    current_A: float


@dataclass(frozen=True)
class ChannelMisfit:
    """How far a model is from one channel.

    Parameters
    ----------
    mean, rms : float
        Of recorded minus predicted, in the channel's unit.
    noise_floor : float or None
        Standard deviation of one reading; None where nothing tells it.
    noise_source : str
        ``repeats``, ``declared``, ``samples`` of a time series, or empty.
    noise_readings : float or None
        Repeats that the floor comes from.
    model_misfit : float
        Of the model to the sweep that it was fitted to, rms in the channel's unit.
    """

    channel: str
    readings: int
    mean: float
    rms: float
    largest: Extreme
    noise_floor: float | None
    noise_source: str
    noise_readings: float | None
    model_misfit: float
    lack_of_fit: Gate | None


@dataclass(frozen=True)
class Comparison:
    """The result of a comparison.

    Parameters
    ----------
    verdict : str
        ``agrees`` within the noise; ``fails``; ``wrong_shape`` where it misses the sweep that it was fitted to as much
        as the measurement; ``compare_only`` without a noise floor.
    channels : tuple of ChannelMisfit
        Each that both the model and the measurement have.
    where : Where
        Where it fails; without a channel where it agrees.
    structure : Gate or None
        The test of smooth patterns, of all channels together.
    mount_m : float or None
        Standard deviation of the distance from mount to mount, where there are several.
    shape : ShapeMisfit or None
        Of a law: how far it is from its own reference, before any measurement.
    findings : tuple of str
        What the reader should know of the data, one plain sentence each.
    placed_by : str
        What tells mounts apart: ``from mount to mount`` where the file has them, else ``from run to run``.
    """

    verdict: CompareVerdict
    channels: tuple[ChannelMisfit, ...]
    where: Where
    structure: Gate | None
    mount_m: float | None
    shape: ShapeMisfit | None
    maps: tuple[MisfitMap, ...]
    findings: tuple[Finding, ...] = ()
    placed_by: str = "from run to run"

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        data = asdict(replace(self, maps=()))
        data["maps"] = [one.to_dict() for one in self.maps]
        return data


def compare_bench(model: ActuatorModel, table: BenchTable, reference: ActuatorModel | None = None) -> Comparison:
    """Compare a model with a bench table.

    Parameters
    ----------
    reference : ActuatorModel or None
        The co-energy that a law was fitted to; without it, the law's file tells its misfit to the sweep alone.

    Raises
    ------
    TableError
        If no reading can be compared.
    """
    return compare_observations(bench_observations(model, table), model, reference)


def compare_observations(
    observations: Observations, model: ActuatorModel, reference: ActuatorModel | None = None
) -> Comparison:
    """Compare observations of any kind with their model.

    Parameters
    ----------
    observations : Observations
        M readings beside what ``model`` predicts.
    """
    comparison = _compared(observations)
    floor = {one.channel: one.noise_floor for one in comparison.channels}
    return replace(comparison, shape=shape_misfit(model, reference, floor.get("force_N")))


def _compared(observations: Observations) -> Comparison:
    """The comparison without the shape of a law."""
    noise = estimate_noise(observations)
    known = noise is not None
    whitening = Whitening(observations, noise or _scatter_as_noise(observations), chains_of(observations))
    channels = tuple(_channel(observations, noise, name) for name in observations.channels)
    rest, space = whitening.full(observations.residual), pattern_space(observations, whitening)
    structure = space.test(rest) if known else None
    verdict: CompareVerdict = "compare_only"
    if structure is not None:
        own = np.sum((observations.tolerance / whitening.noise.sigma[observations.channel]) ** 2)
        fails: CompareVerdict = "fails" if space.excess(rest) > _OWN_MISFIT * own else "wrong_shape"
        verdict = fails if structure.p_value < LEVEL else "agrees"
    where = Where("", (), "The model explains these data within their noise.")
    if verdict != "agrees":
        where = where_it_fails(observations, whitening)
    mounts = len(np.unique(observations.column("mount")))
    return Comparison(
        verdict=verdict,
        channels=channels,
        where=where,
        structure=structure,
        mount_m=noise.mount_m if noise is not None and mounts > 1 else None,
        shape=None,
        maps=misfit_maps(observations),
        findings=observations.findings if known else (*observations.findings, NO_FLOOR),
        placed_by="from mount to mount" if "mount" in observations.given else "from run to run",
    )


def _channel(observations: Observations, noise: NoiseModel | None, name: str) -> ChannelMisfit:
    here = np.flatnonzero(observations.of(name))
    residual, c = observations.residual[here], observations.channels.index(name)
    source: Mapping[str, str] = noise.source if noise is not None else {}
    known = noise is not None and name in source
    worst = int(np.argmax(np.abs(residual)))
    extreme = Extreme(
        float(residual[worst]),
        float(observations.column("distance_m")[here[worst]]),
        float(observations.column("current_A")[here[worst]]),
    )
    return ChannelMisfit(
        channel=name,
        readings=len(here),
        mean=float(residual.mean()),
        rms=float(np.sqrt(np.mean(residual**2))),
        largest=extreme,
        noise_floor=float(noise.sigma[c]) if noise is not None and known else None,
        noise_source=source.get(name, ""),
        noise_readings=float(noise.repeats[c]) if noise is not None and source.get(name) == "repeats" else None,
        model_misfit=float(np.sqrt(np.mean(observations.tolerance[here] ** 2))),
        lack_of_fit=lack_of_fit(observations, noise, name) if noise is not None and known else None,
    )


def _scatter_as_noise(observations: Observations) -> NoiseModel:
    """What smooth patterns leave, in place of a noise that nothing tells: enough to weigh the channels by."""
    patterns, zeros = smooth_patterns(observations), np.zeros(len(observations.channels))
    sigma = np.ones(len(observations.channels))
    for c in range(len(sigma)):
        here, columns = observations.channel == c, patterns.columns[:, patterns.channel == c]
        basis = orthonormal_basis(columns[here])
        rest = observations.residual[here] - basis @ (basis.T @ observations.residual[here])
        sigma[c] = max(float(np.sqrt(rest @ rest / max(len(rest) - basis.shape[1], 1))), 1e-12)
    return NoiseModel(
        channels=observations.channels,
        sigma=sigma,
        rho=zeros,
        mount_m=0.0,
        run=zeros,
        repeats=zeros,
        degrees_of_freedom=zeros,
        source={},
        test_mount_m=0.0,
        test_run=zeros,
    )
