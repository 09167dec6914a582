"""Closed loops: what holds, what is lost and under which name, and why."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from femfit.core.errors import DomainError, MissingPartError
from femfit.simulation.close_loop import close_loop, run_loops
from femfit.simulation.constants import UNCERTAIN
from femfit.simulation.design import design_loop
from femfit.simulation.experiment import Experiment, direct_distance
from femfit.simulation.loop import LoopOutcome, _Watch
from femfit.simulation.plant import with_force_scale
from femfit.simulation.summary import series_table
from support.closed_loop import run
from support.expected import unmentioned
from support.one_current import within
from support.parts import with_circuit, with_motion, with_sensor
from support.readings import LASER_10_V


def test_the_same_seed_gives_the_same_numbers_and_another_seed_others(design):
    loops = (run(design, Experiment("pid", "ukf", (0.022,)), steps=50, seed=seed) for seed in (3, 3, 4))
    first, second, other = (loop.series.distance_m for loop in loops)
    np.testing.assert_array_equal(first, second)
    assert np.all(first[-1] != other[-1])


STUCK = {LoopOutcome.PULLED_IN, LoopOutcome.FELL, LoopOutcome.FILTER_DIVERGED}
BY_UKF, BY_PID = ("backstepping", "ukf", (0.022,)), ("pid", "direct", (0.026,))
LOST = {
    "a sensor that sticks": (BY_UKF, {"stuck_after_s": 0.1}, None, {"steps": 1000}, STUCK),
    "an offset by which the filter diverges": (BY_UKF, {"offset": 0.1}, None, {}, {LoopOutcome.FILTER_DIVERGED}),
    "far too strong": (BY_PID, {"force_scale": 1.5}, 0.0, {"supported_steps": 0}, {LoopOutcome.PULLED_IN}),
    "far too weak": (BY_PID, {"force_scale": 0.6}, 0.0, {"supported_steps": 0}, {LoopOutcome.FELL}),
}


@pytest.mark.parametrize("name", LOST)
def test_a_body_is_lost_by_name_and_never_a_number(levitation_model, design, name):
    how, fault, noise, options, named = LOST[name]
    made = design if noise is None else design_loop(levitation_model, noise=noise)
    result = run(made, Experiment(*how, **fault), **options)
    assert not result.held.any()
    assert set(result.outcome.tolist()) <= named
    assert (result.outcome_time_s > fault.get("stuck_after_s", -1.0)).all()
    if "supported_steps" in options:  # which are recorded, too
        lost = int(np.round(result.outcome_time_s[0] / levitation_model.sample_time_s))
        assert np.isfinite(result.series.distance_m[:lost]).all()
        assert np.isnan(result.series.distance_m[lost:]).all()
    assert np.isnan([result.tracking_rms_m, result.estimate_rms_m]).all()


def test_a_body_that_its_reference_seats_on_a_stop_is_held_and_one_that_meets_it_on_its_way_is_not(design):
    """The far stop lies where the reference ends, or where it never leads."""
    box = design.model.validity
    watch, open_space = _Watch(design.model, 1), np.zeros((2, 1), dtype=bool)
    watch._ends = (box.distance_min_m, 0.03)
    states = np.array([[[0.026, 0.0, 0.4]], [[0.03, 0.0, 0.4]]])
    for state, reference in zip(states, (0.026, 0.03), strict=True):
        observed = SimpleNamespace(mean=state, diverged=np.zeros(1, dtype=bool))
        assert watch.alive(0.0, state, observed, open_space, np.array(reference)).all()
    assert watch.alive(1.0, states[0], observed, open_space, np.array(0.026)).all()
    assert not watch.alive(2.0, states[1], observed, open_space, np.array(0.026)).any()
    assert watch.end()[0].tolist() == [LoopOutcome.FELL]


def test_a_current_beyond_the_model_is_named(levitation_model, design):
    """The controller asks for 0.2..1.12 A, but the plant is known up to 0.37 A alone."""
    narrow = replace(levitation_model, validity=within(levitation_model.validity, high=0.37))
    result = run(design, Experiment("pid", "direct", (0.022,)), supported_steps=0, plant=narrow)
    assert LoopOutcome.CURRENT_OUT_OF_RANGE in set(result.outcome.tolist())


def test_without_noise_the_direct_measurement_is_the_distance(levitation_model):
    design = design_loop(with_sensor(levitation_model, adc_bits=0), noise=0.0)
    result = run(design, Experiment("pid", "direct", (0.022,)), runs=1, steps=200, supported_steps=0)
    np.testing.assert_allclose(direct_distance(design, result.series), result.series.distance_m, atol=1e-8)
    np.testing.assert_allclose(result.series.distance_m, 0.022, atol=1e-7)


def test_time_series_are_written_up_to_the_loss(design, tmp_path):
    experiment = Experiment("backstepping", "direct", (0.022,))
    (lost,) = run_loops(design, [experiment], np.random.default_rng(1), runs=2, duration_s=0.3, recorded=2)
    lost.write_csv(tmp_path / "loops" / "series.csv")
    table = np.genfromtxt(tmp_path / "loops" / "series.csv", delimiter=",", names=True)
    series = lost.result.series
    assert table.dtype.names == tuple(series_table(lost.design, lost.result))
    assert len(table) == np.isfinite(series.distance_m).sum() < 2 * lost.steps
    first = table[table["run"] == 1]
    np.testing.assert_allclose(first["true_distance_m"], series.distance_m[: len(first), 0], rtol=1e-8)


def test_no_run_is_lost_by_dropouts_before_its_loop_is_closed(levitation_model):
    design = design_loop(replace(levitation_model, reference_distances_m=(0.030,)))
    result = run(design, Experiment("pid", "ukf4", (0.030,), dropout_probability=1.0), steps=100)
    assert not result.held.any()
    assert result.outcome_time_s.min() > 0.0


@pytest.mark.nightly
def test_a_held_run_whose_filter_errs_far_more_than_it_expects_is_remarked_on(levitation_model):
    options = {"targets_m": (0.022,), "runs": 4, "seconds": 0.3, "controller": "backstepping", "estimator": "ukf"}
    good = close_loop(levitation_model, **options)
    assert (good.held, good.findings) == (4, ())
    drifting = close_loop(levitation_model, **options, drift_per_s=0.04)
    assert drifting.held == 4
    assert [finding["code"] for finding in drifting.to_dict()["findings"]] == ["innovations"]
    assert drifting.findings[0].size == drifting.normalised_innovation_squared > UNCERTAIN


@pytest.mark.nightly
def test_a_body_held_in_a_limit_cycle_is_not_said_to_be_stable(optical):
    options = {"runs": 2, "seconds": 0.3, "controller": "backstepping", "estimator": "ukf"}
    stable, swinging = (close_loop(optical, **options, gains={"current": ohm}) for ohm in (8.7, 173.0))
    assert (stable.held, stable.findings) == (2, ())
    assert swinging.held == 2
    assert [finding.code for finding in swinging.findings] == ["limit-cycle"]
    pole = swinging.to_dict()["design"]["margins"][0]["slowest_pole_rad_s"]
    assert swinging.findings[0].size == pytest.approx(-pole, rel=1e-6)
    assert "unstable about its rest" in str(swinging).splitlines()[0]


@pytest.mark.nightly
def test_a_plant_unlike_the_model_is_named_as_the_cause(levitation_model):
    strong = replace(with_force_scale(levitation_model, 1.6), name="strong")
    lost = close_loop(levitation_model, plant=strong, runs=4, seconds=0.5, targets_m=(0.026,), estimator="ukf")
    assert lost.held == 0
    assert (lost.cause.code, lost.cause.numbers) == ("asked-for", {"asked_for": ("plant",)})


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"controller": "x"}, "backstepping, pid"),
        ({"estimator": "x"}, "ukf4"),
        ({"runs": 0}, "runs=0"),
        ({"runs": 1.5}, "runs=1.5"),
        ({"recorded": -1}, "recorded=-1"),
        ({"rng": -1}, "-1"),
        ({"noise": -1e-3}, "-0.001 V"),
        ({"noise": float("nan")}, "nan V"),
        ({"force_scale": -1.0}, "force scale"),
        ({"dropout": 3.0}, "dropout"),
        ({"stuck_after_s": -1.0}, "stuck"),
        ({"offset": float("nan")}, "offset"),
        ({"targets_m": 0.02}, "targets_m must be a list of distances in m; instead received 0.02"),
        ({"targets_m": ("near",)}, "near"),
        ({"seconds": -1.0}, "seconds=-1"),
        ({"latency": 1000}, "at most 100 .* received latency=1000"),
        ({"seconds": 1e12}, "fewer seconds"),
        ({"sensors": ("lidar",)}, "hall"),
    ],
)
def test_a_loop_that_cannot_be_run_is_refused_with_what_can(levitation_model, wrong, named):
    options = {"controller": "pid", "targets_m": (0.022,), "runs": 1, "seconds": 0.01}
    with pytest.raises((DomainError, MissingPartError), match=named):
        close_loop(levitation_model, **options | wrong)


def with_laser(rig, **fields):
    return replace(rig, sensor=None, other_sensors=(replace(LASER_10_V, **fields),))


ANYWHERE = {"reference_distances_m": ()}
NO_LOOP = {
    "no circuit": (lambda rig: replace(rig, circuits=()), "circuit"),
    "no motion": (lambda rig: replace(rig, motion=None), "motion"),
    "no sensor": (lambda rig: replace(rig, sensor=None), "sensor"),
    "a supply too weak for 30 mm": (lambda rig: with_circuit(rig, voltage_max_V=1.5), r"\d V"),
    "a body that nothing holds": (lambda rig: replace(with_motion(rig, mass_kg=1.0), **ANYWHERE), "levitates"),
    "a Hall element that is saturated there": (
        lambda rig: with_sensor(rig, sensitivity_V_per_T=2000.0), "sensitivity_V_per_T",
    ),
    "a Hall element that is saturated throughout": (
        lambda rig: replace(with_sensor(rig, sensitivity_V_per_T=2000.0), **ANYWHERE), "sensitivity_V_per_T",
    ),
    "a laser that ends at 10 mm": (lambda rig: with_laser(rig, maximum=1.0), r"0\.\.1 V"),
    "a sample time between those of the controller": (lambda rig: with_laser(rig, sample_time_s=0.75e-3), "multiple"),
}  # fmt: skip


@pytest.mark.parametrize("name", NO_LOOP)
def test_a_model_of_which_no_loop_can_be_designed_is_refused_with_the_remedy(levitation_model, name):
    make, named = NO_LOOP[name]
    with pytest.raises((DomainError, MissingPartError), match=named):
        design_loop(make(levitation_model)).loop_sensors()


def test_a_plant_that_cannot_hold_its_body_there_is_refused(levitation_model):
    with pytest.raises(DomainError):
        close_loop(levitation_model, plant=with_motion(levitation_model, mass_kg=0.1), targets_m=(0.022,), runs=1)


def test_a_loop_counts_its_samples_up_to_the_last(levitation_model):
    parts, options = [], {"controller": "pid", "runs": 1, "seconds": 0.1, "targets_m": (0.022,)}
    close_loop(levitation_model, progress=lambda *part: parts.append(part), **options)
    names, done, total = zip(*parts, strict=True)
    assert set(names) == {"closed loop"}
    assert len(set(total)) == 1
    assert list(done) == sorted(set(done))
    assert total[0] - 50 <= done[-1] < total[0]  # it reports at every 50th sample


LASER = LASER_10_V.noise, 3.0
"""Noise in V, and V of the supply; 0.852 V hold the body."""

FILTERED = {"controller": None, "targets_m": (0.022,), "runs": 4, "seconds": 0.2, "stuck_after_s": 0.05}
CAUSES = {
    "gains": (
        LASER, {"controller": "pid", "gains": {"kp": 40.0, "kd": 1.0}, "seconds": 1.5}, "asked-for",
        "Without the gains given",
    ),
    "latency": (LASER, {"latency": 80, "seconds": 1.5}, "asked-for", "", "Without the latency the same runs hold"),
    "noise that fills the commands": (
        (1.0, 3.0), {}, "noise", "The sensors' noise: laser 1.00 V", "to the driver's limit",
    ),
    "noise without room": (
        (60e-3, 1.02 * 0.852), {}, "noise", "The sensors' noise: laser", "brings a body at rest back",
    ),
    "a fault that was asked for": (None, FILTERED, "asked-for", "Without the fault", "sensor stuck"),
    "a fault where the loop is lost without it": (
        None, FILTERED | {"estimator": "direct", "noise": 0.012}, "noise", "The sensors' noise", "too",
    ),
}  # fmt: skip
LONG = tuple(name for name in CAUSES if name != "noise that fills the commands")


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.nightly] * (n in LONG)) for n in CAUSES])
def test_a_lost_loop_names_its_cause_with_its_numbers_and_never_what_is_done_already(name, optical, levitation_model):
    laser, options, code, first, *words = CAUSES[name]
    options = {"controller": "backstepping", "estimator": "ukf", "runs": 2, "seconds": 0.4, **options}
    model = levitation_model
    if laser:
        noise, highest = laser
        model = with_circuit(with_laser(optical, noise=noise), voltage_max_V=highest)
    loop = close_loop(model, **options)
    assert loop.held < loop.runs
    assert loop.cause.code == loop.to_dict()["cause"]["code"] == code
    assert loop.advice.startswith(first)
    assert not unmentioned(words, loop.advice)
