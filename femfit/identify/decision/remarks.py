"""What is remarked on a campaign: sensors that say nothing, noise that is a guess, errors of the bench that would do.

An error of the bench that no effect of the catalogue is, of the stage or of a sensor's zero, is taken out of the misfit
with whatever sizes it may have; it is said where nothing is left then.
"""

from typing import Any

import numpy as np

from femfit.core.results import Finding
from femfit.identify.constants import CREEP_DEGREE, LEVEL, READINGS_OF_A_STOP
from femfit.identify.decision.campaign import Campaign
from femfit.identify.noise.components import dead_sensors
from femfit.identify.noise.whitening import NoiseModel, stops
from femfit.identify.words import finding


def campaign_remarks(campaign: Campaign) -> list[Finding]:
    """Say which channels cannot be tested, which never vary, and where the noise was guessed or repeats replaced it."""
    tested = set(campaign.patterns.patterns.channel.tolist())
    observations, noise = campaign.observations, campaign.noise
    few, replaced = list[Finding](), list[Finding]()
    for c, name in enumerate(observations.channels):
        if c not in tested:
            few.append(finding("too-few-readings", name, name=name, readings=int(observations.of(name).sum())))
        if name in observations.declared_noise and noise.source[name] == "repeats":
            facts: dict[str, Any] = {"declared": observations.declared_noise[name], "source": observations.noise_source}
            facts |= {"sigma": float(noise.sigma[c]), "repeats": round(noise.repeats[c])}
            replaced.append(finding("declared-noise", name, name=name, **facts))
    return [*few, *dead_sensors(noise.never_varying), *replaced, *guessed_noises(noise)]


def stage_errors(campaign: Campaign) -> list[Finding]:
    """Say that errors of the stage would explain a misfit, where stops have some rows each and no error is known.

    Whatever shifts the stops may have is taken out of the misfit; what several currents show beside it is tested.
    """
    observations, whitening = campaign.observations, campaign.whitening
    number = stops(observations)
    if campaign.noise.stop_m or READINGS_OF_A_STOP * (number.max() + 1) > len(observations.covariates):
        return []
    shifts = whitening.full((number[:, None] == np.unique(number)) * observations.distance_slope[:, None])
    if campaign.patterns.test(whitening.residual, shifts).p_value <= LEVEL:
        return []
    size = float(np.sqrt(np.mean(np.linalg.lstsq(shifts, whitening.residual)[0] ** 2)))
    return [finding("stage-errors", "distance_m", size, error=size)]


def creeping_zeros(campaign: Campaign) -> list[Finding]:
    """Say of which sensor a zero that creeps with the order of the rows would explain a misfit by itself."""
    observations, whitening = campaign.observations, campaign.whitening
    elapsed = observations.row / max(int(observations.row.max()), 1)
    slow = elapsed[:, None] ** np.arange(1, 1 + CREEP_DEGREE)
    findings = []
    for name in observations.channels:
        zeros = slow * observations.of(name)[:, None]
        whitened = whitening.full(zeros)
        if campaign.patterns.test(whitening.residual, whitened).p_value > LEVEL:
            crept = np.ptp((zeros @ np.linalg.lstsq(whitened, whitening.residual)[0])[observations.of(name)])
            findings.append(finding("creeping-zero", name, float(crept), name=name, crept=float(crept)))
    return findings


def guessed_noises(noise: NoiseModel) -> list[Finding]:
    """Say that the noise is a guess, where nothing tells it."""
    sizes = {name: noise.floor[name] for name, source in noise.source.items() if source == "guess"}
    return [finding("guessed-noise", sizes=sizes)] if sizes else []
