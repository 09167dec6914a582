"""Impedances beside a model: how far it is off, at which frequencies and bias, and what would explain it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.core.errors import TableError
from femfit.identify.bench import placed
from femfit.identify.decision.campaign import gather
from femfit.identify.plan import examine_plan
from femfit.model.eddy_currents import EddyBias
from support.campaign import campaign, hidden
from support.eddies import with_eddies
from support.impedances import (
    FREQUENCIES,
    KEY,
    impedance_file,
    impedance_table,
    with_conductivity,
    with_drawn_conductivity,
)
from support.one_current import within

LAG = {"ring_share": 0.2, "diffusion_share": 0.05, "time_s": 2e-3}


@pytest.mark.parametrize(("declared", "rel"), [(None, 0.2), ({"impedance_percent": 0.1}, 0.1)])
def test_a_model_agrees_with_its_own_impedance_and_the_noise_is_a_share(levitation_model, tmp_path, declared, rel):
    path = impedance_file(levitation_model, tmp_path / "z.csv", runs=1 if declared else 2)
    comparison = ff.compare(levitation_model, ff.read_measurement(path, noise=declared))
    assert comparison.verdict == "agrees"
    # 150 differences of repeats of a share of 1e-3 tell it to 6 %; mounts that are assumed take a little of them
    assert [one.noise_floor / one.magnitude for one in comparison.channels] == pytest.approx([1e-3, 1e-3], rel=rel)
    assert {one.noise_source for one in comparison.channels} == {"declared" if declared else "repeats"}
    observations = comparison.observations
    low = observations.column("frequency_Hz") < 100.0
    for name in observations.channels:
        ends = (observations.residual[observations.of(name) & part] for part in (low, ~low))
        assert np.std(next(ends)) == pytest.approx(np.std(next(ends)), rel=0.25)  # of 45 readings and more


def test_where_and_how_much_is_said_with_the_frequency(levitation_model, tmp_path):
    path = impedance_table(levitation_model, tmp_path / "z.csv", [hidden("eddy_current_lag", **LAG)])
    comparison = ff.compare(levitation_model, path)
    assert comparison.verdict == "fails"
    assert comparison.where.channel == "inductance_H"
    assert comparison.where.covariates[0] == "frequency_Hz"
    assert " % of |Z| low, most at " in comparison.where.sentence
    assert "and 10 kHz" in comparison.where.sentence
    worst = {one.channel: one.largest for one in comparison.channels}["inductance_H"]
    assert worst.frequency_Hz == pytest.approx(FREQUENCIES[-1])


def test_frequencies_above_those_of_the_eddy_currents_are_named(levitation_model, tmp_path):
    model = with_eddies(levitation_model)
    table = impedance_table(model, tmp_path / "z.csv")
    eddy = replace(model.eddy, error=replace(model.eddy.error, frequency_max_Hz=1e3))
    said = str(ff.compare(replace(model, eddy=eddy), table))
    above = 2 * 5 * 3 * int((FREQUENCIES > 1e3).sum())
    assert f"{above} readings" in said
    assert "10 kHz" in said


@pytest.mark.parametrize(
    ("name", "parameters"),
    [("turns", {"turns_error": 0.02}), ("core_saturation", {"mmf_loss_6": 0.02})],
)
def test_what_explains_an_impedance_is_named(levitation_model, tmp_path, name, parameters):
    table = impedance_table(levitation_model, tmp_path / "z.csv", [hidden(name, **parameters)])
    found = ff.diagnose(levitation_model, table)
    assert found.verdict == "named"
    assert name in found.missing[0].members


def test_what_the_drawing_s_eddy_currents_explain_is_not_a_lag(levitation_model, tmp_path):
    model = with_eddies(levitation_model)
    table = impedance_table(model, tmp_path / "z.csv")
    assert ff.compare(model, table).verdict == "agrees"
    without = ff.diagnose(levitation_model, table)
    assert without.verdict != "nothing_missing"
    assert without.where.covariates[0] == "frequency_Hz"


def test_the_eddy_currents_own_error_is_not_missing_physics(levitation_model, tmp_path):
    model = with_eddies(levitation_model)
    rougher = replace(model.eddy, resistances_ohm=1.003 * model.eddy.resistances_ohm)
    table = impedance_table(replace(model, eddy=rougher), tmp_path / "z.csv", share=1e-4)
    exact = replace(model, eddy=replace(model.eddy, error=None))
    assert ff.compare(exact, table).verdict == "fails"
    assert ff.compare(model, table).verdict == "wrong_shape"


def test_the_own_error_may_ripple_from_setting_to_setting(levitation_model, tmp_path):
    """As that of reduced states does over the frequency: repeats share it, and nothing is missing."""
    model, rng = with_eddies(levitation_model), np.random.default_rng(1)
    observations = placed(model, impedance_table(model, tmp_path / "z.csv", share=1e-4))
    keys = np.stack([observations.channel, *(observations.column(name) for name in observations.settings)])
    setting = np.unique(keys, axis=1, return_inverse=True)[1].ravel()
    ripple = observations.tolerance * rng.normal(size=setting.max() + 1)[setting]
    found = gather(observations.with_values(observations.value + ripple), [])
    # 150 settings of each channel: no more than independent ones make; smooth patterns alone leave hundreds of it
    assert np.mean(found.whitening.residual**2) < 1.0


def test_readings_at_rest_do_not_show_a_conductivity(levitation_model, tmp_path):
    model = with_drawn_conductivity(levitation_model)
    found = ff.diagnose(model, campaign(model, 1))
    notes = {one.name: one.note for one in found.ranking}
    assert "frequency" in notes[KEY]


def test_a_plan_of_impedances_is_examined(levitation_model, tmp_path):
    path = impedance_file(levitation_model, tmp_path / "plan.csv")
    frame = pd.read_csv(path)
    frame.assign(**{"|Z|": "", "theta [deg]": ""}).to_csv(path, index=False)
    report = examine_plan(levitation_model, path)
    assert set(report.noise) == {"inductance_H", "resistance_ohm"}
    assert "eddy_current_lag" in report.detectable
    assert ("resistance", "coil_temperature") in report.together


SHARE = -0.12  # As much as another permeability may look like a conductivity


def solved_about(model, current, materials=("core",)):
    """The model with eddy currents that were solved about a current of each circuit."""
    drawn = with_drawn_conductivity(model)
    box = model.validity
    distances = np.array([box.distance_min_m, box.distance_max_m])
    return replace(drawn, eddy=replace(drawn.eddy, bias=EddyBias(distances, np.full((2, 1), current), materials)))


def at_half_an_ampere(model, path, share=SHARE):
    """Impedances of eddy currents as of another conductivity, at one bias of 0.5 A over 2 mm."""
    box = within(model.validity, distance_min_m=0.016, distance_max_m=0.018, low=0.5, high=0.5)
    return impedance_table(replace(with_conductivity(model, share), validity=box), path, biases=1)


def test_what_was_read_away_from_the_bias_is_not_compared(levitation_model, tmp_path):
    """There another permeability looks like another conductivity."""
    table, model = at_half_an_ampere(levitation_model, tmp_path / "z.csv"), solved_about(levitation_model, 1.2)
    with pytest.raises(TableError, match=r"eddy_bias_A = 0\.5"):
        placed(model, table)
    rows = [at_half_an_ampere(levitation_model, tmp_path / "z.csv").rows for _ in range(2)]
    both = replace(table, rows=pd.concat([rows[0], rows[1].assign(current_A=1.2)], ignore_index=True))
    seen = placed(model, both)
    assert seen.covariates["current_A"].unique() == [1.2]
    assert [one.size for one in seen.findings if one.code == "eddy-bias"] == [len(rows[0])]


@pytest.mark.parametrize("bias", [0.5, None])
def test_at_the_bias_a_wrong_conductivity_keeps_its_name(levitation_model, tmp_path, bias):
    model = with_drawn_conductivity(levitation_model) if bias is None else solved_about(levitation_model, bias)
    found = ff.diagnose(model, at_half_an_ampere(levitation_model, tmp_path / "z.csv"))
    assert [one.name for one in found.missing] == [KEY]
    assert found.missing[0].parameters["change"] == pytest.approx(SHARE, abs=0.01)


def test_a_noise_in_ohm_is_the_same_at_every_frequency(levitation_model, tmp_path):
    table = ff.read_measurement(
        impedance_file(levitation_model, tmp_path / "z.csv", runs=1), noise={"resistance_ohm": 0.05}
    )
    observations = placed(levitation_model, table)
    assert observations.declared_noise == {"resistance_ohm": 0.05}
    assert set(observations.magnitude) == {"inductance_H"}
    here = observations.of("resistance_ohm")
    np.testing.assert_allclose(observations.value[here], table.rows["resistance_ohm"], rtol=1e-12)
