"""What no effect explains: found where it acts, learnt to the noise, nothing on clean data, and run in filters."""

import functools
import runpy

import numpy as np
import pytest

import femfit as ff
from femfit.core.errors import TableError
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect, EffectParameter
from femfit.identify.add_effects import add_effects, whitening_beside
from femfit.identify.bench import placed
from femfit.identify.decision.diagnosis import Diagnosis
from femfit.identify.noise.whitening import Whitening
from femfit.identify.remainder.learn import (
    Beside,
    Penalised,
    columns_at,
    learn,
    posterior,
    sets_that_pay,
)
from femfit.identify.remainder.parts import BRAKE, COENERGY, FORCE_BRANCH, HALL_FIELD, NAME, parts_of
from femfit.model.bspline import TensorSpline, basis_matrix
from femfit.model.carried import Brake, Carried, Curve, FieldTerm, bounded_basis, carried_effect
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.magnetics import CoenergySpline
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of, with_effects
from femfit.simulation.plant import Plant
from femfit.targets.estimator import FILE
from support.campaign import NOISE, campaign, hidden
from support.closed_loop import closed_loop, recorded
from support.one_current import flat

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

    def learn_from(name):
        size = {"distances": 24 if name == "screw" else 12, "currents": 4}
        return add_effects(levitation_model, campaign(levitation_model, 5, change=causes[name], **size), NAME)

    return functools.cache(learn_from)


@pytest.mark.parametrize(
    ("cause", "parts"),
    [
        pytest.param("load cell", ("force_N",), marks=pytest.mark.nightly),
        ("energy", (COENERGY,)),
        pytest.param("screw", ("distance_m",), marks=pytest.mark.nightly),
    ],
)
def test_it_is_learnt_where_it_acts_and_to_the_noise(learnt, cause, parts):
    result = learnt(cause)
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
    [
        pytest.param("load cell", "(F / ", marks=pytest.mark.nightly),
        ("energy", "i/(1.4 A) exp(-(d - 15 mm) / "),
        pytest.param("screw", "sin(2 pi d / ", marks=pytest.mark.nightly),
    ],
)
def test_the_short_law_is_that_of_the_cause(learnt, cause, text):
    law = learnt(cause).laws[0]
    assert law.fits
    assert text in law.text
    if cause != "screw":
        return
    size, _, rest = law.text.partition(" sin(2 pi d / ")
    assert float(rest.split()[0]) == pytest.approx(1e3 * PERIOD_M, rel=0.02)
    assert size.endswith("µm")
    assert float(size.split()[0]) == pytest.approx(1e6 * WAVE_M, rel=0.15)


def test_the_learnt_energy_is_the_true_one(learnt, levitation_model):
    d, i = (x.ravel() for x in np.meshgrid(np.linspace(0.0155, 0.03, 8), np.linspace(0.2, 1.3, 5)))
    learnt_force = flat(learnt("energy").model.magnetics).force(d, i) - flat(levitation_model.magnetics).force(d, i)
    true_force = 4e-5 / 4e-3 * i * np.exp((0.015 - d) / 4e-3)
    # A campaign of re-mounts of 20 um where the force's slope is 60 N/m, at 0.4 mN of noise, knows it to 1 mN
    np.testing.assert_allclose(learnt_force, true_force, atol=1e-3)
    assert true_force.max() > 0.01


def test_the_refutation_names_a_setting_where_the_remainder_says_much(learnt, levitation_model):
    asked = learnt("energy").refutation
    at = Conditions(nominal_of(levitation_model))
    here = np.array([asked.distance_m]), np.array([asked.current_A])
    models = learnt("energy").model, levitation_model
    there, plain = (predict_readings(one, *here, at)[asked.channel][0] for one in models)
    assert there - plain == pytest.approx(asked.change)
    assert abs(asked.change) > 5.0 * asked.noise


def test_clean_readings_teach_nothing(levitation_model):
    result = add_effects(levitation_model, campaign(levitation_model, 6), NAME)
    assert not result.parts
    assert not result.accepted
    assert result.model.effects == ()
    assert result.to_dict()["remainder"]["parts"] == []


@pytest.mark.nightly
def test_a_name_that_explains_as_much_comes_first(levitation_model):
    table = campaign(levitation_model, 7, [hidden("force_gain", gain_error=0.04)])
    result = add_effects(levitation_model, table, NAME)
    assert result.named_instead == "force_gain"
    assert not result.accepted


@pytest.mark.nightly
def test_friction_in_the_linkage_of_the_force_sensor_turns_with_the_branch(levitation_model):
    def rubbing(readings, rows):
        return {**readings, "force_N": readings["force_N"] - 1e-3 * rows["branch"].to_numpy()}

    result = add_effects(levitation_model, campaign(levitation_model, 11, change=rubbing), NAME)
    assert result.parts == (FORCE_BRANCH,)
    assert result.accepted
    fall = {one.channel: one for one in result.fall.channels}["force_N"]
    assert fall.before_over_noise > 2.0
    assert fall.after_over_noise < 1.3


@pytest.mark.nightly
def test_names_are_fitted_first(levitation_model):
    table = campaign(
        levitation_model,
        8,
        change=lambda readings, rows: bent_load_cell(readings | {"hall_V": readings["hall_V"] + 0.02}, rows),
        runs=2,
    )
    result = add_effects(levitation_model, table, [NAME, "hall_offset"], base="never")
    assert [one.effect.name for one in result.model.effects] == ["hall_offset", NAME]
    assert result.parts == ("force_N",)
    assert result.beside.added[0].parameters["offset_V"] == pytest.approx(0.02, abs=2e-3)
    anew = add_effects(result.model, table, NAME)
    assert [one.effect.name for one in anew.model.effects] == ["hall_offset", NAME]


@pytest.mark.nightly
def test_a_remainder_shrinks_where_its_cause_is_found(learnt, levitation_model):
    # Learnt as a load cell's error from readings that a gain explains: beside the gain its share goes to nothing
    table = campaign(levitation_model, 9, effects=[hidden("force_gain", gain_error=0.05)])
    wrong = with_effects(levitation_model, learnt("load cell").added)
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
    assert ("Add unexplained" in str(error.value)) == offered


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
    readings = Penalised(y, columns)
    expected = 0.5 * (y @ y - y @ np.linalg.solve(covariance, y) - np.linalg.slogdet(covariance)[1])
    assert readings.having(roots).log_evidence - readings.having({}).log_evidence == pytest.approx(expected)
    assert readings.having(roots).solved.log_det == pytest.approx(np.linalg.slogdet(covariance)[1])
    prior = np.zeros((5, 5))
    prior[:3, :3], prior[3:, 3:] = roots[0] @ roots[0].T, np.eye(2)
    x = np.concatenate(columns, axis=1)
    mean, spread = posterior(readings, roots, {})
    np.testing.assert_allclose(np.concatenate([*mean.values()]), prior @ x.T @ np.linalg.solve(covariance, y))
    np.testing.assert_allclose(spread, np.linalg.inv(np.linalg.inv(prior) + x.T @ x))


def test_a_part_that_must_not_be_negative_is_fitted_so():
    rng = np.random.default_rng(4)
    columns = [np.abs(rng.normal(size=(60, 3)))]
    readings = Penalised(columns[0] @ np.array([1.0, -0.5, 2.0]) + 0.1 * rng.normal(size=60), columns)
    mean, _ = posterior(readings, {0: 10.0 * np.eye(3)}, {0: np.ones(3, bool)})
    assert 0.0 <= mean[0].min() < 1e-12
    assert mean[0][2] > 1.0


def test_noise_alone_pays_for_nothing():
    rng = np.random.default_rng(5)
    columns = [rng.normal(size=(300, 6)), rng.normal(size=(300, 2))]
    roots = [[np.eye(6), np.diag(np.arange(1.0, 7.0))], [np.eye(2)]]
    assert sum(bool(sets_that_pay(Penalised(rng.normal(size=300), columns), roots)) for _ in range(200)) <= 4


@pytest.mark.nightly
@pytest.mark.parametrize(("noise_N", "told"), [(1e-3, True), (3e-3, False)])
def test_other_parts_that_the_readings_allow_are_said(levitation_model, noise_N, told):
    # From a few noisy forces alone nobody can tell a bent load cell from a changed field
    table = campaign(levitation_model, 10, change=bent_load_cell, noise={"force_N": noise_N}, distances=5, currents=4)
    result = add_effects(levitation_model, table, NAME)
    assert result.parts == ("force_N",)
    assert result.alternatives == (() if told else ((COENERGY,),))


SHARE = EffectParameter("share", bounds=(0.0, 2.0), plausible=(0.0, 1.0), description="How much of it is there.")
SENSORS = {"distance_m": 3e-5, "current_A": 4e-3}
COGGING_N, PITCH_M = 3e-3, 4e-3


def there(carried):
    return AddedEffect(carried_effect("hidden", "Something.", [SHARE], carried), {"share": 1.0})


@pytest.fixture(scope="module")
def cogging():
    """A force that comes and goes with the distance, as of teeth, whatever the current: 3 mN sin(2 pi d / 4 mm)."""
    knots, expand = bounded_basis(0.015, 0.045, cells=60, degree=4)
    d = np.linspace(0.015, 0.045, 400)
    wanted = COGGING_N * PITCH_M / (2.0 * np.pi) * np.cos(2.0 * np.pi * d / PITCH_M)
    rows = basis_matrix(d, knots, 4) @ expand
    spline = TensorSpline(knots, np.array([-9.0, 9.0]), 4, 0, (expand @ np.linalg.lstsq(rows, wanted)[0])[:, None])
    coenergy = CoenergySpline(DistanceCoordinate(1.0, inverse=False), spline)
    return there(Carried((FieldTerm("share", coenergy=coenergy),)))


@pytest.fixture(scope="module")
def learnt_from_record(model, cogging):
    record = recorded(closed_loop(model, [cogging], runs=2, seconds=2.0, seed=5), runs=(1, 2), **SENSORS)
    return ff.add_effects(model, record, NAME)


@pytest.mark.nightly
def test_a_force_that_comes_and_goes_is_learnt_from_a_record(learnt_from_record):
    assert learnt_from_record.parts[0] == COENERGY
    assert learnt_from_record.accepted
    fall = {one.channel: one for one in learnt_from_record.fall.channels}["force_balance_N"]
    assert fall.before_over_noise > 2.0
    assert fall.after_over_noise < 1.3
    assert learnt_from_record.filter.better
    assert learnt_from_record.filter.mean_square[1] < 0.5 * learnt_from_record.filter.mean_square[0]


def test_clean_records_teach_nothing(model, clean_record):
    result = ff.add_effects(model, clean_record, NAME)
    assert not result.accepted
    assert not result.parts or result.fall_unseen < 9.0


def test_a_brake_is_learnt_as_one_that_never_pushes(model, clean_record):
    knots, expand = bounded_basis(0.0, 0.1, cells=6, degree=4)
    speed = np.linspace(0.0, 0.1, 60)
    shape = np.linalg.lstsq(basis_matrix(speed, knots, 4) @ expand, 6e-3 * np.tanh(speed / 0.02) ** 3)[0]
    truth = there(Carried(brake=Brake(1e-3, Curve("share", knots, 4, np.maximum(expand @ shape, 0.0)))))
    observations = placed(model, clean_record)
    change = observations.predict([truth]) - observations.base
    braked = observations.with_values(observations.value + change)
    noise = whitening_beside(observations).noise
    parts = [part for part in parts_of(braked) if part.kind in {BRAKE, "current_A"}]
    whitening = Beside(Whitening(braked, noise), np.zeros((len(braked.value), 0)))
    found = learn(whitening, parts, columns_at(braked, parts))
    assert [part.kind for part in found.coefficients] == [BRAKE]
    curve = found.effects[0].effect.carried.brake.against
    assert curve.coefficients.min() >= 0.0
    left = braked.value - braked.predict(found.effects)
    here = braked.of("force_balance_N")
    assert np.std(left[here]) < 1.1 * np.std(observations.residual[here])
    assert np.std(change[here]) > 0.5 * np.std(observations.residual[here])


@pytest.mark.nightly
def test_the_loop_closes_and_the_export_runs_with_it(learnt_from_record, tmp_path):
    loop = ff.close_loop(learnt_from_record.model, runs=1, seconds=0.3, rng=1)
    assert "lost" not in str(loop).splitlines()[0]
    ff.export(learnt_from_record.model, tmp_path / "package")
    plant, ours = runpy.run_path(str(tmp_path / "package" / FILE))["Plant"], Plant(learnt_from_record.model)
    for distance, current in ((0.024, 0.3), (0.9, 2.0)):  # inside of the sweep and far beyond
        state = [distance, 0.0, current]
        moved, wanted = plant(state), ours.start(np.array([state]))
        for _ in range(20):
            found, wanted = moved.step([1.1]), ours.step(wanted, np.full((1, 1), 1.1))
        np.testing.assert_allclose(found, wanted[0], rtol=1e-9, atol=1e-12)
