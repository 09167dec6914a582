"""A model that misses its own table: what a diagnosis grants it, and what it says that this could hide."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.text import amount
from femfit.effects.catalogue import all_effects, effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.identify.comparison.compare import compare
from femfit.identify.constants import LEVEL
from femfit.identify.decision.allowances import also_allowed
from femfit.identify.decision.campaign import detectable_magnitudes, gather
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.decision.diagnosis_text import verdict_sentence
from femfit.identify.decision.naming import decide
from femfit.identify.experiments.suggest import suggest
from femfit.identify.readings.bench import bench_observations
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.model.validity import Misfit, ValidityBox
from support.campaign import campaign

POT = LawMagnetics("F1e", (Coefficient("d^-2", 2, 2.2e-6, "N m^2 / A^2"),), {}, 0.03)
HIDDEN = [("force_gain", "gain_error"), ("distance_offset", "offset_m"), ("current_gain", "gain_error")]


def ripple(share):
    """What a coarse spline misses: a share of the force that changes its sign."""

    def change(readings, rows):
        wave = np.sin(2e3 * rows["distance_m"].to_numpy()) * np.cos(3.0 * rows["current_A"].to_numpy())
        return {"force_N": readings["force_N"] * (1.0 + share * wave)}

    return change


def coarse(model, share=0.02, noise=4e-3):
    """The model with the misfit of a coarse fit, and what makes tables with that misfit in them, seed by seed."""
    size = float(np.sqrt(np.mean(campaign(model, 1, noise={"force_N": 1e-9}).rows["force_N"] ** 2)))
    rms = 0.5 * share * size
    known = replace(model, misfit=Misfit(rms, 3.0 * rms, share, None, None, None, 99, "sweep"))

    def table(seed, effects=()):
        return campaign(known, seed, effects, noise={"force_N": noise * size}, mount_m=2e-6, change=ripple(share))

    return known, table


def gathered(device, seed, effects=()):
    model, table = device
    return gather(bench_observations(model, table(seed, effects)), list(all_effects().values()))


@pytest.fixture
def solenoid(levitation_model):
    return coarse(replace(levitation_model, magnetics=POT, validity=ValidityBox(5e-4, 5.5e-3, 0.5, 2.0), sensor=None))


@pytest.fixture(params=["levitation", "solenoid"])
def device(request, levitation_model, solenoid):
    return coarse(levitation_model) if request.param == "levitation" else solenoid


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.long)])
@pytest.mark.parametrize(("name", "amplitude"), HIDDEN)
def test_what_is_said_to_show_is_not_passed_for_the_models_own_misfit(device, name, amplitude, seed):
    effect, clean = effect_by_name(name), gathered(device, seed)
    assert decide(clean).own_misfit
    limit = detectable_magnitudes(clean, LEVEL)[name][amplitude]
    for size in (1.5 * limit, -1.5 * limit):
        hidden = AddedEffect(effect, effect.null() | {amplitude: size})
        assert decide(gathered(device, seed, [hidden])).verdict != "nothing_missing"


def test_the_verdict_says_both_misfits_the_assumed_factor_and_what_to_sweep(levitation_model):
    finer = {"distance_m": [1.25e-3, 2.75e-3], "current_A": [0.35]}
    model, table = coarse(replace(levitation_model, provenance={"fit": {"finer_sweep": finer}}))
    data = table(1)
    found, compared = diagnose(model, data, bootstrap=0), compare(model, data)
    force = next(one for one in compared.channels if one.channel == "force_N")
    assert found.own_misfit
    said = verdict_sentence(found)
    wanted = [
        amount(force.rms, "N"),
        amount(force.model_misfit, "N"),
        amount(2.0 * force.model_misfit, "N"),
        "no more than the size is known",
    ]
    assert [words for words in wanted if words not in said] == []
    for text in (str(found), str(compared), str(suggest(model, data, found))):
        assert said in text
        assert "1.25 and 2.75 mm and the currents 0.35 A" in text


def test_a_test_that_passes_beside_a_channel_beyond_its_noise_says_what_it_allows_for(levitation_model):
    model, table = coarse(levitation_model)
    observations = bench_observations(model, table(1))
    text = also_allowed(observations, {"force_N": "the force by 5 N"})
    assert text == f"the model's own misfit in any pattern, {amount(model.misfit.force_rms_N, 'N')} rms of the force"
    assert also_allowed(observations, {}) == ""


def test_a_law_is_to_be_replaced_by_the_co_energy_rather_than_swept_again(solenoid):
    model, table = solenoid
    advice = str(suggest(model, table(1)))
    assert "Fit the co-energy" in advice
    assert "[sweep]" not in advice
