"""The noise that a measurement will have which nobody has made yet: as estimated or declared, or as assumed."""

from dataclasses import replace

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.effects.conditions import Nominal
from femfit.identify.constants import PRIOR_MOUNT_M, PRIOR_RUN
from femfit.identify.experiments.constants import GUESSED_NOISE
from femfit.identify.noise.whitening import NoiseModel
from femfit.identify.readings.observations import Observations
from femfit.tables.circuit_columns import parts_of


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
    known = {name: k for k, name in enumerate(noise.channels)}
    picked = [known.get(name) for name in observations.channels]
    guessed = np.array([assumed_noise(name, observations.nominal) for name in observations.channels])

    def pick(values: FloatArray, missing: FloatArray) -> FloatArray:
        return np.array([m if k is None else values[k] for k, m in zip(picked, missing, strict=True)])

    zeros, run = np.zeros(len(picked)), PRIOR_RUN * guessed
    return replace(
        noise,
        channels=observations.channels,
        sigma=pick(noise.sigma, guessed),
        rho=pick(noise.rho, zeros),
        run=pick(noise.run, run),
        repeats=pick(noise.repeats, zeros),
        degrees_of_freedom=pick(noise.degrees_of_freedom, zeros),
        mount_m=noise.mount_m or PRIOR_MOUNT_M,
        test_mount_m=noise.test_mount_m or PRIOR_MOUNT_M,
        test_run=pick(np.where(noise.test_run > 0.0, noise.test_run, PRIOR_RUN * noise.sigma), run),
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
