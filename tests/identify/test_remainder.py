"""What no effect explains: learnt where it acts and to the noise, nothing on clean data, and run in filters."""

import functools
import runpy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import femfit as ff
from femfit.effects.effect import AddedEffect, EffectParameter
from femfit.identify.before_after import run_facts, suspicious_values
from femfit.identify.remainder import COENERGY, NAME, given, likeliest_root
from femfit.model.bspline import DistanceCoordinate, TensorSpline, basis_matrix
from femfit.model.carried import Carried, FieldTerm, bounded_basis
from femfit.model.magnetics import CoenergySpline
from femfit.model.with_effects import with_effects
from femfit.simulation.plant import Plant
from femfit.targets.estimator import FILE
from support.campaign import NOISE, campaign, hidden
from support.closed_loop import closed_loop, recorded
from support.one_current import flat


def stray_energy(readings, rows):
    """dW' = 40 uJ/A i exp(-(d - 15 mm) / 4 mm), and nothing at the Hall element."""
    d, i = rows["distance_m"].to_numpy(), rows["current_A"].to_numpy()
    decay = 4e-5 * np.exp((0.015 - d) / 4e-3)
    force, flux = readings["force_N"] + decay / 4e-3 * i, readings["flux_linkage_Wb"] + decay
    return {**readings, "force_N": force, "flux_linkage_Wb": flux}


def learnt_of(model, seed, cause, effects=NAME):
    return ff.add_effects(model, campaign(model, seed, change=cause, distances=12, currents=4), effects)


@pytest.fixture(scope="module")
def learnt(levitation_model):
    """Each cause learnt from three runs."""

    def bent(readings, rows):
        """It reads 6 % too much at 0.3 N, in proportion to the square."""
        return readings | {"force_N": readings["force_N"] + 0.2 * readings["force_N"] ** 2}

    causes = {"load cell": bent, "energy": stray_energy}
    return functools.cache(lambda name: learnt_of(levitation_model, 5, causes[name]))


@pytest.mark.parametrize(
    ("cause", "parts"),
    [pytest.param("load cell", ("force_N",), marks=pytest.mark.nightly), ("energy", (COENERGY,))],
)
def test_it_is_learnt_where_it_acts_and_to_the_noise(learnt, cause, parts):
    result = learnt(cause)
    assert result.parts == parts
    assert result.accepted
    assert result.lack_of_fit_before.p_value < 1e-3
    assert result.lack_of_fit_after.p_value > 0.01
    # Three runs may differ by 0.6 of the noise, so that what all have in common is learnt with less weight
    for name in ("flux_linkage_Wb", "hall_V", "voltage_V"):
        assert result.left_out[name] < 1.2 * NOISE[name]
    # A re-mount of 20 um, which no model can know, is in the force of a run left out
    worst = {one.channel: one for one in result.fall.channels}["force_N"]
    assert worst.before_over_noise > 1.4
    assert worst.after_over_noise < 1.3


def test_the_learnt_energy_is_the_true_one(learnt, levitation_model):
    d, i = (x.ravel() for x in np.meshgrid(np.linspace(0.0155, 0.03, 8), np.linspace(0.2, 1.3, 5)))
    learnt_force = flat(learnt("energy").model.magnetics).force(d, i) - flat(levitation_model.magnetics).force(d, i)
    true_force = 4e-5 / 4e-3 * i * np.exp((0.015 - d) / 4e-3)
    # A campaign of re-mounts of 20 um where the force's slope is 60 N/m, at 0.4 mN of noise, knows it to 1 mN
    np.testing.assert_allclose(learnt_force, true_force, atol=1e-3)
    assert true_force.max() > 0.01


def test_clean_readings_and_records_teach_nothing(levitation_model, model, clean_record):
    result = ff.add_effects(levitation_model, campaign(levitation_model, 6), NAME)
    assert not result.parts
    assert not result.accepted
    assert result.model.effects == ()
    assert result.to_dict()["remainder"]["parts"] == []
    result = ff.add_effects(model, clean_record, NAME)
    assert not result.accepted
    assert not result.parts or result.fall_unseen < 9.0


def test_a_channel_whose_error_rises_on_runs_left_out_is_named_and_what_is_left_of_it_is_no_noise(levitation_model):
    # A force sensor that counts a pull as negative
    result = learnt_of(levitation_model, 5, lambda readings, rows: readings | {"force_N": -readings["force_N"]})
    assert result.fall_unseen > 9.0  # over all channels the weighted error falls
    assert result.risen == ("flux_linkage_Wb",)
    assert result.objections == ("risen",)
    assert not result.accepted
    assert "Not accepted" in str(result)
    assert "rises in flux linkage." in str(result)
    assert result.lack_of_fit_after.p_value > 0.01  # mounts of any distance could have made it
    assert result.beyond_noise["flux_linkage_Wb"] > 50.0
    assert "what is left is noise" not in str(result)


def test_what_keeps_a_model_from_running_is_said(learnt):
    turned = replace(learnt("energy"), inductance_H={"before": 0.1, "after": -0.06})
    assert turned.objections == ("inductance",)
    assert "the inductance goes down to -60 mH" in str(turned)
    forces_alone = replace(turned, inductance_H={"before": 0.0, "after": 0.0})
    assert forces_alone.accepted
    lost = replace(turned, inductance_H={}, filter={"mean_square": {"before": 1.23, "after": None}})
    assert lost.objections == ("lost",)
    assert "1.23 -> lost" in str(lost)


def test_a_co_energy_that_bends_down_with_the_current_has_no_inductance_and_no_filter(levitation_model, clean_record):
    rest, plain = levitation_model.smallest_inductance_H, DistanceCoordinate(1.0, kind="distance")
    grid = levitation_model.inductance(*levitation_model.validity.grid(9, 9))
    assert rest == pytest.approx(grid.min())
    assert rest > 0.0
    # A hill over the currents from -1 to 1 A
    knots = np.repeat([-1.0, 1.0], 5)
    bent = -rest * np.linspace(-1.0, 1.0, 5)[None, :] ** 2
    spline = TensorSpline(np.array([0.0, 1.0]), knots, 0, 4, bent)
    bending = replace(levitation_model, magnetics=CoenergySpline(plain, spline))
    assert bending.smallest_inductance_H < 0.0
    facts = run_facts(levitation_model, bending, clean_record)
    assert facts["inductance_H"] == {"before": rest, "after": bending.smallest_inductance_H}
    squares = facts["filter"]["mean_square"]
    assert squares["before"] == pytest.approx(1.0, abs=0.3)
    assert squares["after"] is None


def test_an_unusual_share_of_what_was_learnt_is_said_with_its_size(learnt):
    result = learnt("energy")
    (added,) = result.added
    large = replace(added, parameters={"share": 1.4}, ci95={"share": (1.3, 1.5)})
    fit = SimpleNamespace(effects=[large], converged=True, active=[], free=[])
    (sentence,) = suspicious_values(result.observations, fit)
    assert "(140 %). That is unusual: 0 to 100 % is usual." in sentence


def test_effects_and_what_is_learnt_beside_them_are_one_verdict(levitation_model):
    clean = campaign(levitation_model, 6, [hidden("hall_offset", offset_V=0.02)])
    result = ff.add_effects(levitation_model, clean, [NAME, "hall_offset"])
    assert not result.parts
    first, *_, last = str(result).splitlines()
    assert first.startswith("Added hall_offset: the test finds nothing in what is left")
    assert last.startswith("Nothing was learnt beside it")
    assert result.accepted  # so that what is said to be added is written


@pytest.mark.nightly
def test_the_error_with_effects_and_what_is_learnt_falls_from_that_of_the_model_as_given(levitation_model):
    def both(readings, rows):
        return stray_energy(readings | {"hall_V": readings["hall_V"] + 0.02}, rows)

    result = learnt_of(levitation_model, 8, both, [NAME, "hall_offset"])
    given = {one.channel: one for one in result.fall.channels}["hall_V"]
    assert given.rms_before == pytest.approx(np.hypot(0.02, NOISE["hall_V"]), rel=0.05)
    assert given.rms_after < 1.3 * NOISE["hall_V"]
    assert str(result).count("Added") == 1
    assert "usual" not in str(result)


@pytest.mark.nightly
def test_a_remainder_shrinks_where_its_cause_is_found(learnt, levitation_model):
    # Learnt as a load cell's error from readings that a gain explains: beside the gain its share goes to nothing
    table = campaign(levitation_model, 9, effects=[hidden("force_gain", gain_error=0.05)])
    wrong = with_effects(levitation_model, learnt("load cell").added)
    result = ff.add_effects(wrong, table, "force_gain")
    found = {one.effect.name: one.parameters for one in result.model.effects}
    assert found[NAME]["share"] < 0.3
    assert found["force_gain"]["gain_error"] == pytest.approx(0.05, abs=0.01)


def test_evidence_and_mean_are_those_of_the_normal_distribution():
    rng = np.random.default_rng(2)
    columns, roots = [rng.normal(size=(40, 3)), rng.normal(size=(40, 2))], [np.diag([1.0, 0.5, 2.0]), np.eye(2)]
    y = columns[0] @ np.array([2.0, -1.0, 0.5]) + rng.normal(size=40)
    x, prior = np.concatenate(columns, axis=1), np.diag([1.0, 0.25, 4.0, 1.0, 1.0])
    covariance = np.eye(40) + x @ prior @ x.T
    expected = 0.5 * (y @ y - y @ np.linalg.solve(covariance, y) - np.linalg.slogdet(covariance)[1])
    assert given(y, columns, roots).log_evidence - given(y, [], []).log_evidence == pytest.approx(expected)
    mean = np.concatenate([roots[0].ravel()[[0, 4, 8]], np.ones(2)]) * given(y, columns, roots).amplitudes
    np.testing.assert_allclose(mean, prior @ x.T @ np.linalg.solve(covariance, y))
    # The size that is found is likelier than others
    beside = given(y, columns[:1], roots[:1])
    log_evidence, best = likeliest_root(beside, columns[1], roots[1:])
    assert log_evidence == pytest.approx(given(y, columns, [roots[0], best]).log_evidence)
    for factor in (1.5, 0.67):
        assert log_evidence > given(y, columns, [roots[0], factor * best]).log_evidence - 0.1


COGGING_N, PITCH_M = 3e-3, 4e-3


@pytest.fixture(scope="module")
def learnt_from_record(model):
    """A force that comes and goes with the distance, as of teeth, whatever the current: 3 mN sin(2 pi d / 4 mm)."""
    knots, expand = bounded_basis(0.015, 0.045, cells=60, degree=4)
    d = np.linspace(0.015, 0.045, 400)
    wanted = COGGING_N * PITCH_M / (2.0 * np.pi) * np.cos(2.0 * np.pi * d / PITCH_M)
    rows = basis_matrix(d, knots, 4) @ expand
    spline = TensorSpline(knots, np.array([-9.0, 9.0]), 4, 0, (expand @ np.linalg.lstsq(rows, wanted)[0])[:, None])
    coenergy = CoenergySpline(DistanceCoordinate(1.0, kind="distance"), spline)
    share = EffectParameter("share", bounds=(0.0, 2.0), plausible=(0.0, 1.0), description="How much of it is there.")
    carried = Carried((FieldTerm("share", coenergy=coenergy),)).effect("hidden", "Something.", [share])
    cogging = AddedEffect(carried, {"share": 1.0})
    loops = closed_loop(model, [cogging], runs=2, seconds=2.0, seed=5)
    record = recorded(loops, runs=(1, 2), distance_m=3e-5, current_A=4e-3)
    return ff.add_effects(model, record, NAME)


@pytest.mark.nightly
def test_a_force_that_comes_and_goes_is_learnt_from_a_record(learnt_from_record):
    assert learnt_from_record.parts[0] == COENERGY
    assert learnt_from_record.accepted
    fall = {one.channel: one for one in learnt_from_record.fall.channels}["force_balance_N"]
    assert fall.before_over_noise > 2.0
    assert fall.after_over_noise < 1.3
    squares = learnt_from_record.filter["mean_square"]
    assert 1.0 < squares["after"] < 0.5 * squares["before"]


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
