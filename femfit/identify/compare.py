"""How far a model is from measurements, against their noise, and where: ``femfit compare``."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

import numpy as np

from femfit.core.results import Finding, Plotted, Result
from femfit.estimate.follow import OneFilter, followed
from femfit.identify.bench import measurement_of, placed
from femfit.identify.constants import WITHIN_NOISE
from femfit.identify.decision.campaign import considered_effects, gather
from femfit.identify.decision.naming import decide, fails_surely
from femfit.identify.decision.remarks import campaign_remarks
from femfit.identify.lack_of_fit import LackOfFit, Where, where_it_fails
from femfit.identify.misfit import allowed, beyond_noise, sweep_words
from femfit.identify.noise.components import estimate_noise, noise_by_smoothness
from femfit.identify.noise.whitening import NoiseModel, Whitening
from femfit.identify.observations import Observations
from femfit.identify.words import printed
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.tables.measurement import Measurement, TimeSeries

CompareVerdict = Literal["agrees", "fails", "wrong_shape", "compare_only"]


@dataclass(frozen=True)
class Extreme:
    """The largest misfit of a channel: recorded minus predicted in the channel's unit, and where."""

    value: float
    distance_m: float
    current_A: float
    currents_A: tuple[float, ...] = ()  # Of several circuits
    frequency_Hz: float | None = None  # Of an impedance


@dataclass(frozen=True)
class ChannelMisfit:
    """How far a model is from one channel."""

    channel: str
    readings: int
    # Mean and rms of recorded minus predicted, in the channel's unit
    mean: float
    rms: float
    largest: Extreme
    noise_floor: float | None  # Standard deviation of one reading; None where it is unknown
    noise_source: str  # ``repeats``, ``declared``, ``guess``, ``samples`` of a time series, or empty
    noise_readings: float | None  # Degrees of freedom of the repeats that the noise comes from
    # Root mean square of the model's misfit to the table that it was fitted to, in the channel's unit
    model_misfit: float
    magnitude: float | None = None  # Of impedances: |Z| in the channel's unit at which all of them are given


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Plotted, Result):
    """The result of a comparison; printed, it is what ``femfit compare`` prints.

    Parameters
    ----------
    verdict : str
        ``agrees`` within the noise; ``fails``; ``wrong_shape`` where it misses the table that it was fitted to as much
        as the measurement; ``compare_only`` where the noise is unknown or the readings are too few.
    channels : tuple of ChannelMisfit
        Each that both the model and the measurement have.
    where : Where
        Where it fails; without a channel where it agrees.
    p_value : float or None
        Of the lack of fit in smooth patterns.
    structure : LackOfFit or None
        That test, in the worst of its groups of patterns.
    noise : NoiseModel or None
        Of the readings; None where it is unknown.
    beyond_noise : mapping of str to float
        Channels whose error is more than 1.2 times what declared noise, or repeats, show, and more than by chance, and
        how many times the noise of one reading it is.
    filter : OneFilter or None
        A record through the model's filter; None of a bench table, and where the model has no filter for it.

    Examples
    --------
    >>> import femfit as ff
    >>> comparison = ff.compare(ff.read_model("model.json"), "bench.csv")
    >>> [misfit.channel for misfit in comparison.channels]
    ['force_N', 'flux_linkage_Wb', 'hall_V', 'voltage_V']
    """

    data = "verdict", "p_value", "beyond_noise", "where", "structure", "channels", "noise", "findings", "filter"

    verdict: CompareVerdict
    channels: tuple[ChannelMisfit, ...]
    where: Where
    p_value: float | None
    structure: LackOfFit | None
    noise: NoiseModel | None
    beyond_noise: Mapping[str, float]
    observations: Observations
    model: ActuatorModel
    findings: tuple[Finding, ...] = ()
    filter: OneFilter | None = None

    def __str__(self) -> str:
        rms = self.observations.rms(self.observations.residual)
        scattered = [c for c in self.channels if c.noise_floor and c.rms > WITHIN_NOISE * c.noise_floor]
        return printed(
            "compare",
            r=self,
            a=allowed(self.observations, self.noise, rms),
            scattered=scattered,
            guessed=any(channel.noise_source == "guess" for channel in self.channels),
            **sweep_words(self.model),
        )


def compare(model: ActuatorModel | str | Path, data: Measurement | str | Path) -> Comparison:
    """Compare a model with measurements: misfit per channel against its noise, lack of fit, and where it fails.

    Parameters
    ----------
    model : ActuatorModel or path
    data : BenchTable or TimeSeries, or a path
        What was measured.

    Raises
    ------
    TableError
        If no reading can be compared.

    Examples
    --------
    >>> comparison = ff.compare(ff.read_model("model.json"), "bench.csv")
    >>> comparison.verdict, comparison.where.channel
    ('fails', 'voltage_V')
    """
    model, data = model_of(model), measurement_of(data)
    observations = placed(model, data)
    campaign = gather(observations, considered_effects((), observations.nominal))
    if isinstance(campaign, Finding):
        noise, remarks, test, verdict = estimate_noise(observations), [campaign], None, "compare_only"
        whitening = Whitening(observations, noise or noise_by_smoothness(observations))
    else:
        whitening, noise, remarks = campaign.whitening, campaign.noise, campaign_remarks(campaign)
        observations, test, verdict = campaign.observations, campaign.patterns.test(whitening.residual), "fails"
        if not fails_surely(campaign) and (decision := decide(campaign)).verdict == "nothing_missing":
            verdict = "wrong_shape" if decision.own_misfit else "agrees"
    rms, misfit = (observations.rms(values) for values in (observations.residual, observations.tolerance))
    beyond = beyond_noise(observations, noise, rms)
    where = Where("", (), "" if beyond else "The model explains these data within their noise.")
    return Comparison(
        verdict=cast("CompareVerdict", verdict),
        channels=tuple(_channel(observations, noise, name, rms[name], misfit[name]) for name in observations.channels),
        where=where if verdict == "agrees" else where_it_fails(observations, whitening),
        p_value=test.p_value if test else None,
        structure=test,
        noise=noise,
        beyond_noise=beyond,
        observations=observations,
        model=model,
        findings=(*observations.findings, *remarks),
        filter=followed(model, data) if isinstance(data, TimeSeries) else None,
    )


def _channel(
    observations: Observations, noise: NoiseModel | None, name: str, rms: float, model_misfit: float
) -> ChannelMisfit:
    residual, source = observations.residual, noise.source.get(name, "") if noise else ""
    of_channel, c = np.flatnonzero(observations.of(name)), observations.channels.index(name)
    worst = of_channel[np.argmax(np.abs(residual[of_channel]))]
    row, names = observations.covariates.iloc[observations.row[worst]], observations.currents
    currents = tuple(float(row[current]) for current in names) if len(names) > 1 else ()
    frequency = float(row["frequency_Hz"]) if observations.of_impedances else None
    return ChannelMisfit(
        channel=name,
        readings=len(of_channel),
        mean=float(residual[of_channel].mean()),
        rms=rms,
        largest=Extreme(float(residual[worst]), float(row["distance_m"]), float(row["current_A"]), currents, frequency),
        noise_floor=float(noise.sigma[c]) if noise and source else None,
        noise_source=source,
        noise_readings=float(noise.repeats[c]) if noise and "repeats" in source else None,
        model_misfit=model_misfit,
        magnitude=observations.magnitude.get(name),
    )
