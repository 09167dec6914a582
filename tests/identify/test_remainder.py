"""What no effect explains: found where it acts, learnt to the noise, nothing on clean data, and what is said of it."""

import numpy as np
import pytest

from femfit.core.errors import TableError
from femfit.effects.conditions import Conditions
from femfit.identify.decision.diagnosis import Diagnosis
from femfit.identify.readings.bench import placed
from femfit.identify.refit.add_effects import add_effects
from femfit.identify.remainder.evidence import Gram, complexity, evidence, posterior, sets_that_pay
from femfit.identify.remainder.parts import BRAKE, COENERGY, FORCE_BRANCH, HALL_FIELD, NAME, parts_of
from femfit.model.json_file import model_from_dict, model_to_dict
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of, with_effects
from support.campaign import NOISE, campaign

PERIOD_M, WAVE_M = 5e-3, 8e-5


def bent_load_cell(readings, rows):
    """It reads 6 % too much at 0.3 N, in proportion to the square."""
    force = readings["force_N"]
    return {**readings, "force_N": force + 0.2 * force**2}


def stray_energy(readings, rows):
    """dW' = 40 uJ/A i exp(-(d - 15 mm) / 4 mm), and nothing at the Hall element."""
    d, i = rows["distance_m"].to_numpy(), rows["current_A"].to_numpy()
    decay = 4e-5 * np.exp((0.015 - d) / 4e-3)
    force, flux = readings["force_N"] + decay / 4e-3 * i, readings["flux_linkage_Wb"] + decay
    return {**readings, "force_N": force, "flux_linkage_Wb": flux}


def screw_error(model):
    """The stage's screw: the body is at d + 80 um sin(2 pi d / 5 mm) where d is recorded."""

    def change(readings, rows):
        d, i = rows["distance_m"].to_numpy(), rows["current_A"].to_numpy()
        at = Conditions(nominal_of(model))
        there = predict_readings(model, d + WAVE_M * np.sin(2.0 * np.pi * d / PERIOD_M), i, at)
        here = predict_readings(model, d, i, at)
        return {name: value + there[name] - here[name] for name, value in readings.items()}

    return change


@pytest.fixture(scope="module")
def learnt(levitation_model):
    """Each cause learnt from three runs."""
    causes = {"load cell": bent_load_cell, "energy": stray_energy, "screw": screw_error(levitation_model)}
    return {
        name: add_effects(levitation_model, campaign(levitation_model, 5, change=one, distances=24, currents=4), NAME)
        for name, one in causes.items()
    }


@pytest.mark.parametrize(
    ("cause", "parts"), [("load cell", ("force_N",)), ("energy", (COENERGY,)), ("screw", ("distance_m",))]
)
def test_it_is_learnt_where_it_acts_and_to_the_noise(learnt, cause, parts):
    result = learnt[cause]
    assert result.parts == parts
    assert result.accepted
    assert result.lack_of_fit_before.p_value < 1e-3  # a screw's period is finer than the patterns of the test
    assert result.lack_of_fit_after.p_value > 0.01
    for name in ("flux_linkage_Wb", "hall_V", "voltage_V"):
        assert result.left_out[name] < 1.15 * NOISE[name]
    # A re-mount of 20 um, which no model can know, is in the force of a run left out
    worst = {one.channel: one for one in result.fall.channels}["force_N"]
    assert worst.before_over_noise > 1.4
    assert worst.after_over_noise < 1.3


@pytest.mark.parametrize(
    ("cause", "text"),
    [("load cell", "(F / "), ("energy", "i/(1.4 A) exp(-(d - 15 mm) / "), ("screw", "sin(2 pi d / ")],
)
def test_the_short_law_is_that_of_the_cause(learnt, cause, text):
    law = learnt[cause].laws[0]
    assert law.fits
    assert text in law.text
    assert f"{law.text}" in str(learnt[cause])


def test_the_screws_law_has_its_period_and_size(learnt):
    size, _, rest = learnt["screw"].laws[0].text.partition(" sin(2 pi d / ")
    assert float(rest.split()[0]) == pytest.approx(1e3 * PERIOD_M, rel=0.02)
    assert size.endswith("µm")
    assert float(size.split()[0]) == pytest.approx(1e6 * WAVE_M, rel=0.15)


def test_the_learnt_energy_is_the_true_one(learnt, levitation_model):
    d, i = (x.ravel() for x in np.meshgrid(np.linspace(0.0155, 0.03, 8), np.linspace(0.2, 1.3, 5)))
    learnt_force = learnt["energy"].model.magnetics.force(d, i) - levitation_model.magnetics.force(d, i)
    true_force = 4e-5 / 4e-3 * i * np.exp((0.015 - d) / 4e-3)
    # A campaign of re-mounts of 20 um where the force's slope is 60 N/m, at 0.4 mN of noise, knows it to 1 mN
    np.testing.assert_allclose(learnt_force, true_force, atol=1e-3)
    assert true_force.max() > 0.01


def test_the_refutation_names_a_setting_where_the_remainder_says_much(learnt, levitation_model):
    asked = learnt["energy"].refutation
    at = Conditions(nominal_of(levitation_model))
    here = np.array([asked.distance_m]), np.array([asked.current_A])
    models = learnt["energy"].model, levitation_model
    there, plain = (predict_readings(one, *here, at)[asked.channel][0] for one in models)
    assert there - plain == pytest.approx(asked.change)
    assert abs(asked.change) > 5.0 * asked.noise
    assert "To refute it, read the" in str(learnt["energy"])


def test_it_is_called_unexplained_and_survives_its_file(learnt):
    result = learnt["energy"]
    again = model_from_dict(model_to_dict(result.model))
    assert [one.effect.name for one in again.effects] == [NAME]
    assert model_to_dict(again) == model_to_dict(result.model)
    assert "unexplained: of no known cause" in str(result)
    assert "changes the force by up to" in str(result)


def test_clean_readings_teach_nothing(levitation_model):
    result = add_effects(levitation_model, campaign(levitation_model, 6), NAME)
    assert not result.parts
    assert not result.accepted
    assert result.model.effects == ()
    assert str(result).startswith("Nothing was added")
    assert result.to_dict()["remainder"]["parts"] == []


def test_a_name_that_explains_as_much_comes_first(levitation_model):
    def gain(readings, rows):
        return {**readings, "force_N": 1.04 * readings["force_N"]}

    result = add_effects(levitation_model, campaign(levitation_model, 7, change=gain), NAME)
    assert result.named_instead == "force_gain"
    assert not result.accepted
    assert "Not accepted: force_gain, a named effect" in str(result)


def test_friction_in_the_linkage_of_the_force_sensor_turns_with_the_branch(levitation_model):
    def rubbing(readings, rows):
        return {**readings, "force_N": readings["force_N"] - 1e-3 * rows["branch"].to_numpy()}

    result = add_effects(levitation_model, campaign(levitation_model, 11, change=rubbing), NAME)
    assert result.parts == (FORCE_BRANCH,)
    assert result.accepted
    assert "while the current rises" in str(result)
    fall = {one.channel: one for one in result.fall.channels}["force_N"]
    assert fall.before_over_noise > 2.0
    assert fall.after_over_noise < 1.3


def test_names_are_fitted_first(levitation_model):
    def two(readings, rows):
        return bent_load_cell({**readings, "hall_V": readings["hall_V"] + 0.02}, rows)

    table = campaign(levitation_model, 8, change=two)
    result = add_effects(levitation_model, table, [NAME, "hall_offset"], base="never")
    assert [one.effect.name for one in result.model.effects] == ["hall_offset", NAME]
    assert result.parts == ("force_N",)
    assert result.beside.added[0].parameters["offset_V"] == pytest.approx(0.02, abs=2e-3)
    anew = add_effects(result.model, table, NAME)
    assert [one.effect.name for one in anew.model.effects] == ["hall_offset", NAME]


def test_a_remainder_shrinks_where_its_cause_is_found(learnt, levitation_model):
    # Learnt as a load cell's error from readings that a gain explains: beside the gain its share goes to nothing
    table = campaign(levitation_model, 9, change=lambda r, rows: {**r, "force_N": 1.05 * r["force_N"]})
    wrong = with_effects(levitation_model, learnt["load cell"].added)
    result = add_effects(wrong, table, "force_gain", base="never")
    found = {one.effect.name: one.parameters for one in result.model.effects}
    assert found[NAME]["share"] < 0.3
    assert found["force_gain"]["gain_error"] == pytest.approx(0.05, abs=0.01)


@pytest.mark.parametrize(("verdict", "offered"), [("unexplained", True), ("nothing_missing", False)])
def test_a_diagnosis_that_is_unexplained_offers_it(levitation_model, verdict, offered):
    found = object.__new__(Diagnosis)
    for name, value in (("verdict", verdict), ("missing", ())):
        object.__setattr__(found, name, value)
    with pytest.raises(TableError) as error:
        add_effects(levitation_model, campaign(levitation_model, 6), found)
    assert ("Add unexplained to learn what it leaves." in str(error.value)) == offered


def test_parts_are_those_that_the_readings_can_show(levitation_model):
    observations = placed(levitation_model, campaign(levitation_model, 6))
    kinds = [part.kind for part in parts_of(observations)]
    assert kinds[:3] == [COENERGY, HALL_FIELD, "distance_m"]
    assert BRAKE not in kinds  # nothing moves on a bench


def test_the_evidence_is_that_of_the_normal_distribution():
    rng = np.random.default_rng(2)
    columns = [rng.normal(size=(40, 3)), rng.normal(size=(40, 2))]
    y = columns[0] @ np.array([2.0, -1.0, 0.5]) + rng.normal(size=40)
    roots = {0: np.diag([1.0, 0.5, 2.0]), 1: np.eye(2)}
    covariance = np.eye(40) + sum(columns[k] @ root @ root.T @ columns[k].T for k, root in roots.items())
    gram = Gram.of(columns, y)
    expected = 0.5 * (y @ y - y @ np.linalg.solve(covariance, y) - np.linalg.slogdet(covariance)[1])
    assert evidence(gram, roots) == pytest.approx(expected)
    assert complexity(gram, roots) == pytest.approx(np.linalg.slogdet(covariance)[1])
    prior = np.zeros((5, 5))
    prior[:3, :3], prior[3:, 3:] = roots[0] @ roots[0].T, np.eye(2)
    x = np.concatenate(columns, axis=1)
    found = posterior(gram, roots, {})
    np.testing.assert_allclose(np.concatenate([*found.mean.values()]), prior @ x.T @ np.linalg.solve(covariance, y))
    np.testing.assert_allclose(found.covariance, np.linalg.inv(np.linalg.inv(prior) + x.T @ x))


def test_a_part_that_must_not_be_negative_is_fitted_so():
    rng = np.random.default_rng(4)
    columns = [np.abs(rng.normal(size=(60, 3)))]
    gram = Gram.of(columns, columns[0] @ np.array([1.0, -0.5, 2.0]) + 0.1 * rng.normal(size=60))
    found = posterior(gram, {0: 10.0 * np.eye(3)}, {0: np.ones(3, bool)})
    assert 0.0 <= found.mean[0].min() < 1e-12
    assert found.mean[0][2] > 1.0


def test_noise_alone_pays_for_nothing():
    rng = np.random.default_rng(5)
    columns = [rng.normal(size=(300, 6)), rng.normal(size=(300, 2))]
    roots = [[np.eye(6), np.diag(np.arange(1.0, 7.0))], [np.eye(2)]]
    assert sum(bool(sets_that_pay(Gram.of(columns, rng.normal(size=300)), roots)) for _ in range(200)) <= 4


@pytest.mark.parametrize(("noise_N", "told"), [(1e-3, True), (3e-3, False)])
def test_other_parts_that_the_readings_allow_are_said(levitation_model, noise_N, told):
    # From a few noisy forces alone nobody can tell a bent load cell from a changed field
    table = campaign(levitation_model, 10, change=bent_load_cell, noise={"force_N": noise_N}, distances=5, currents=4)
    result = add_effects(levitation_model, table, NAME)
    assert result.parts == ("force_N",)
    assert result.alternatives == (() if told else ((COENERGY,),))
    assert ("These readings also allow a change of the co-energy" in str(result)) != told
