"""A seating is told from current and voltage when it happens, and not where the body is blocked before."""

from dataclasses import replace

import numpy as np
import pytest

import femfit as ff
from femfit.device.electrics import CurrentSensor
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.estimate.follow import filter_of, noise_of
from femfit.estimate.prepare import prepare
from femfit.estimate.run_filter import replay
from femfit.estimate.seating import fastest, run_rivals
from femfit.model.validity import ProcessNoise, ValidityBox
from support.replays import damped, logs
from support.solenoids import solenoid
from support.switching import CURRENT_A, STEP_S, logged, switched


def model(restitution=0.2):
    """With a current sensor alone, and a near stop that returns a part of the speed."""
    motion = solenoid().motion
    motion = replace(motion, near_stop=replace(motion.near_stop, restitution=restitution))
    shunt = CurrentSensor(name="current", noise=CURRENT_A, circuit="coil")
    return replace(solenoid(motion), sample_time_s=STEP_S, other_sensors=(shunt,))


def seen(device, loop, seed):
    return ff.observe(device, logged([loop], seed=seed, drop=("distance_m",)), find=False)


def arrival(loop):
    return next(event for event in loop.events if event.name == "hits_near")


@pytest.mark.parametrize(
    ("restitution", "records", "least"),  # of intervals of 95 %: fewer in 0.3 % and 1.6 % of such sets
    [(0.6, 2, 1), *(pytest.param(share, 20, 17, marks=pytest.mark.nightly) for share in (0.0, 0.6))],
)
def test_the_interval_holds_the_time_of_the_first_touch_and_the_speed_is_right(restitution, records, least):
    device = model(restitution)
    loop = switched([0.0, 0.02], [0.0, 12.0], 0.1, model=device)
    truth, held = arrival(loop), 0
    for seed in range(records):
        first = seen(device, loop, seed).seatings[0]
        assert first.stop == "near"
        assert first.confidence > 0.999
        assert first.velocity_m_s == pytest.approx(truth.velocity_m_s, rel=0.1)
        assert first.high_s - first.low_s < 6.0 * STEP_S
        held += first.low_s <= truth.time_s <= first.high_s
    assert held >= least


def test_a_body_that_is_blocked_before_its_stop_is_not_said_to_seat_with_certainty():
    """An obstacle at 1 mm, of which the model knows nothing."""
    device = model()
    stop = replace(device.motion.near_stop, distance_m=1e-3)
    blocked = replace(device, motion=replace(device.motion, near_stop=stop))
    loop = switched([0.0, 0.02], [0.0, 12.0], 0.1, model=blocked)
    for seed in range(2):
        for one in seen(device, loop, seed).seatings:
            assert one.stop != "near" or one.confidence < 0.95, seed


def test_without_a_current_an_arrival_is_not_told():
    """At the far stop the current is over: both hypotheses predict the same readings."""
    device = model()
    loop = switched([0.0, 0.02, 0.1], [0.0, 12.0, 0.0], 0.2, model=device)
    found = seen(device, loop, 3)
    assert all(one.confidence < 0.999 for one in found.seatings if one.stop == "far")
    assert any(one.confidence > 0.999 for one in found.seatings if one.stop == "near")


@pytest.mark.nightly
def test_a_body_that_lies_on_a_stop_does_not_seat_when_a_current_finds_it_there():
    """Without a current the estimate wanders off; the pulse brings it, not the body, back to the stop."""
    device = replace(model(), process_noise=ProcessNoise(acceleration_density=400.0, voltage_V=0.012))
    loop = switched([0.0, 0.02], [0.0, 12.0], 0.03, model=device)
    assert not [event for event in loop.events if event.name.startswith("hits")]
    for seed in range(2):
        assert all(one.confidence < 0.95 for one in seen(device, loop, seed).seatings), seed


def test_a_body_in_the_middle_seats_nowhere():
    device = model()
    record = logged([switched([0.0], [0.0], 0.1, model=device)], drop=("distance_m",))
    assert not ff.observe(device, record, find=False).seatings
    assert np.isfinite(record.rows["current_A"]).all()


def offset_by(record, amperes):
    """The record of an ammeter with a wrong zero."""
    return replace(record, rows=record.rows.assign(current_A=record.rows["current_A"] + amperes))


@pytest.mark.nightly
@pytest.mark.parametrize("amperes", [0.02, 0.05, -0.05])
def test_a_filter_that_does_not_follow_the_readings_claims_neither_seatings_nor_rests(amperes):
    device = model()
    loop = switched([0.0, 0.02, 0.1], [0.0, 12.0, 0.0], 0.2, model=device)
    found = ff.observe(device, offset_by(logged([loop], drop=("distance_m",)), amperes), find=False)
    assert found.seatings
    assert "Seats on" not in str(found)
    assert "at-stop" not in {finding.code for finding in found.findings}


def test_no_body_seats_faster_than_its_spring_makes_it():
    motion = Mechanics(
        0.025, 0.0, springs=(Spring(200.0, 0.1, 4e-3),), near_stop=Stop(0.2e-3, 0.5), far_stop=Stop(4e-3, 0.2)
    )
    device = replace(solenoid(motion), validity=ValidityBox.of_currents((0.2e-3, 4e-3), (0.0, 0.0)))
    work = sum(0.5 * 3.8e-3 * float(motion.static_force(np.array(d))) for d in (0.2e-3, 4e-3))  # of a linear spring
    assert fastest(device, 1.0) == pytest.approx(np.sqrt(2.0 * work / 0.025 / (1.0 - 0.5**2)), rel=1e-3)
    assert fastest(device, -1.0) == 0.0  # without a current nothing brings it back


def test_a_rival_that_goes_on_is_the_filter_itself_where_nothing_is_near():
    """It starts with the whole covariance of the estimate, with what distance, speed and current have in common."""
    _, (record,) = logs(400, 1, seed=5)
    prepared = prepare(damped(), record, ("current",))
    built = filter_of(prepared, "ukf", None, noise_of(prepared, None))
    replayed = replay(built, prepared.log)
    stop, candidates, rows = Stop(0.2e-3, 0.0), np.array([201, 202]), slice(201, 260)
    rivals = run_rivals(prepared, built, (200, 259), candidates, (stop, -1.0, replayed))
    squares = replayed.innovation[rows] ** 2 / replayed.variance[rows] + np.log(replayed.variance[rows])
    assert rivals.likelihood[-1] == pytest.approx(-0.5 * squares.sum(), rel=1e-9)
