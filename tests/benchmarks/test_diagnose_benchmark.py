"""Processor time of a diagnosis of a thousand rows in four channels, with 30 effects and 20 numbers of the drawing.

Asked are 3 s, and 20 s for 40 simulated clean campaigns. Both are printed by their parts; nothing is asserted of them.
"""

from dataclasses import replace
from statistics import median
from time import process_time

import numpy as np
import pytest

from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.identify.decision.campaign import considered_effects, gather
from femfit.identify.decision.diagnose import diagnose_observations
from femfit.identify.decision.naming import decide
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.simulate import simulated_noise
from femfit.identify.readings.place import placed
from femfit.model.carried import FieldTerm
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.drawn_effect import DrawnEffect, parameter_name
from support.campaign import campaign
from support.splines import REFERENCE_DISTANCE, fitted_spline

NUMBERS, CLEAN = 20, 10
"""Numbers of the drawing; simulated clean campaigns of which the median is taken."""


def drawn(k):
    """A number of a drawing: 0.2 % of W' a millimetre, as a decay of its own times a power of the current."""
    power, length, currents = k % 3, 0.006 + 0.001 * k, np.linspace(0.0, 1.4, 8)

    def decay(d):
        return np.exp(-(d - REFERENCE_DISTANCE) / length)

    coenergy = fitted_spline(lambda d, i: (2e-6, 6e-4, 6e-4)[power] * decay(d) * i**power, currents, 2)
    hall = fitted_spline(lambda d, i: 1e-4 * decay(d) + 0.0 * i, currents, 1)
    term = FieldTerm(parameter_name("mm"), DistanceCoordinate(REFERENCE_DISTANCE), coenergy, hall)
    return DrawnEffect(f"part{k}.r_mm[0]", (), f"part{k}.r_mm[0]", 10.0, "mm", 0.1, (term,))


def seconds(work, times=3):
    """What the work gives, and its processor time, the median of several."""
    spent = []
    for _ in range(times):
        start = process_time()
        result = work()
        spent.append(process_time() - start)
    return result, median(spent)


@pytest.mark.benchmark
def test_a_thousand_rows_with_all_effects_and_twenty_numbers(levitation_model):
    model = replace(levitation_model, drawn=tuple(drawn(k) for k in range(NUMBERS)))
    saturation = effect_by_name("core_saturation")
    hidden = [AddedEffect(saturation, saturation.null() | {"mmf_loss_6": 0.02})]
    observations = placed(model, campaign(model, 1, hidden, distances=15, currents=11))
    effects = considered_effects((), (), observations.nominal.drawn)
    result, whole = seconds(lambda: diagnose_observations(model, observations))
    assert result.missing[0].name == "core_saturation"
    gathered, gathering = seconds(lambda: gather(observations, effects))
    _, deciding = seconds(lambda: decide(gathered))
    tested = {one.name for one in gathered.effects}
    print(
        f"\n{len(observations.covariates)} rows x {len(observations.channels)} channels, {len(tested)} effects and "
        f"numbers in {len(gathered.effects)} variants: {whole:.1f} s (3 s asked); noise and columns {gathering:.1f}, "
        f"decision {deciding:.1f}, the rest {whole - gathering - deciding:.1f}"
    )
    rng, named, parts = np.random.default_rng(1), 0, []
    for _ in range(CLEAN):
        start = process_time()
        clean = observations.base + simulated_noise(gathered.whitening, rng)
        noise, of_noise = seconds(lambda: estimate_noise(observations.with_values(clean)), 1)  # noqa: B023
        simulated, reading = seconds(lambda: gathered.with_readings(clean), 1)  # noqa: B023
        decision, of_decision = seconds(lambda: decide(simulated), 1)  # noqa: B023
        assert noise is not None
        named += decision.verdict in {"named", "form_insufficient"}
        parts.append((process_time() - start - of_noise, of_noise, reading - of_noise, of_decision))
    each = [median(part) for part in zip(*parts, strict=True)]
    print(
        f"40 simulated clean campaigns: {40.0 * each[0]:.0f} s (20 s asked); a campaign takes {each[0]:.2f} s: noise "
        f"{each[1]:.2f}, columns {each[2]:.2f}, decision {each[3]:.2f}; something named in {named} of {CLEAN}"
    )
