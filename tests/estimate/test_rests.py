"""Rests on stops, held bodies, lift-off and seatings are recognised, and a hover or a blocked body is none of them."""

from dataclasses import replace

import numpy as np
import pytest

import femfit as ff
from femfit.device.electrics import CurrentSensor
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.estimate.follow import filter_of, noise_of
from femfit.estimate.prepare import prepare
from femfit.estimate.rests import Track, find_rests
from femfit.estimate.run_filter import replay
from femfit.estimate.seating import fastest, run_rivals
from femfit.model.validity import ValidityBox
from support.closed_loop import closed_loop, recorded
from support.replays import damped, logs
from support.solenoids import solenoid
from support.switching import CURRENT_A, DISTANCE_M, STEP_S, logged, switched


def rests_of(model, record):
    return find_rests(model, Track(*columns_of(record), DISTANCE_M))


def columns_of(record):
    *columns, current = (record.rows[name].to_numpy() for name in ("time_s", "segment", "distance_m", "current_A"))
    return *columns, current[:, None]


@pytest.fixture(scope="module")
def free():
    return switched([0.0, 0.02, 0.08], [0.0, 12.0, 0.0], 0.12)


@pytest.fixture(scope="module")
def blocked():
    return [switched([0.0, 0.02, 0.04], [0.0, 12.0, 4.0], 0.06, start_m=at, blocked=True) for at in (1.5e-3, 3e-3)]


def test_rests_on_both_stops_lie_where_the_simulated_body_rests(free):
    found = rests_of(solenoid(), logged([free]))
    assert {rest.place for rest in found.rests} == {"near", "far"}
    still = free.table["velocity_m_s"] == 0.0
    assert found.held[still].mean() > 0.85  # blocks at the ends are given away
    off = np.minimum(np.abs(free.table["distance_m"] - 0.2e-3), np.abs(free.table["distance_m"] - 4e-3))
    assert off[found.held].max() < 2.0 * DISTANCE_M  # bounces that noise hides
    assert not found.contact[(free.table["distance_m"] > 0.5e-3) & (free.table["distance_m"] < 3.5e-3)].any()


def test_the_samples_around_every_impact_are_contact_however_fast_the_body_is():
    model = solenoid()
    elastic = replace(model.motion, far_stop=Stop(model.motion.far_stop.distance_m, 0.9))
    loop = switched([0.0], [0.0], 0.06, model=replace(model, motion=elastic), start_m=1e-3)
    record = logged([loop])
    rows = record.rows.iloc[::8].reset_index(drop=True)
    found = rests_of(model, replace(record, rows=rows))
    times = rows["time_s"].to_numpy()
    hits = [event for event in loop.events if event.name == "hits_far" and abs(event.velocity_m_s) > 0.2]
    assert len(hits) == 2
    for event in hits:
        after = int(np.searchsorted(times, event.time_s))
        assert found.contact[after - 1 : after + 1].all(), event


def test_departure_is_told_before_the_body_has_gone_as_far_as_the_noise(free):
    found = rests_of(solenoid(), logged([free]))
    starts = next(event.time_s for event in free.events if event.name == "starts")
    gone = 1e-4 * np.argmax(free.table["distance_m"] < 4e-3 - 2.0 * DISTANCE_M)
    assert starts - 1e-3 < 1e-4 * found.rests[0].last < gone
    said = next(one.text for one in found.findings if one.code == "lift-off")
    by = float(said.partition(" by ")[2].split()[0])
    assert starts < 1e-3 * by < starts + 5e-3, said


def test_a_blocked_body_away_from_stops_is_held_whatever_the_model_misses(blocked):
    for factor in (0.7, 1.0, 1.5):
        model = solenoid()
        wrong = replace(model, magnetics=Scaled(model.magnetics, factor))
        found = rests_of(wrong, logged(blocked))
        assert {rest.place for rest in found.rests} == {"held"}
        assert found.held.mean() > 0.9


class Scaled:
    """Another model's magnetics with another force."""

    def __init__(self, magnetics, factor):
        self.magnetics, self.factor = magnetics, factor

    def force(self, distance, currents):
        return self.factor * self.magnetics.force(distance, currents)


def test_a_body_that_swings_on_its_spring_is_free():
    model = solenoid()
    motion = Mechanics(0.025, 0.0, springs=model.motion.springs)
    loop = ff.simulate(replace(model, motion=motion), voltage_V=0.0, duration_s=0.3, start_m=3.7e-3, sample_time_s=1e-4)
    stiffer = replace(motion, springs=(replace(motion.springs[0], stiffness_N_per_m=120.0),))
    assert not rests_of(replace(model, motion=stiffer), logged([loop])).rests


@pytest.mark.nightly
def test_a_hover_is_free_though_the_model_misses_a_fifth_of_its_force(levitation_model):
    model = replace(levitation_model, sample_time_s=1e-3)
    record = recorded(closed_loop(model, runs=2, seconds=2.0, seed=3), distance_m=3e-5, current_A=4e-3)
    for factor in (0.8, 1.0, 1.25):
        wrong = replace(model, magnetics=Scaled(model.magnetics, factor))
        assert not find_rests(wrong, Track(*columns_of(record), 3e-5)).rests


@pytest.mark.parametrize("with_blocked", [True, pytest.param(False, marks=pytest.mark.nightly)])
def test_compare_agrees_on_switching_with_and_without_blocked_runs(free, blocked, with_blocked):
    """A body that is balanced as free while it is held misses by hundreds of times the noise."""
    comparison = ff.compare(solenoid(), logged([free, *(blocked if with_blocked else ())]))
    assert comparison.verdict == "agrees", str(comparison)
    codes = {one.code for one in comparison.findings}
    assert "at-stop" in codes
    assert ("held" in codes) == with_blocked


def test_a_filter_does_not_let_a_held_body_fall(blocked):
    seen = ff.observe(solenoid(), logged(blocked), find=False)
    one = seen.filters[0]
    assert "is held" in str(seen).splitlines()[1]
    judged = {each.sensor: each for each in one.innovations}
    assert judged["distance"].mean_square == pytest.approx(1.0, abs=0.15)
    assert judged["current"].mean_square == pytest.approx(1.0, abs=0.15)


def test_noise_of_the_sensors_alone_leaves_a_resting_body_at_rest():
    generator = np.random.default_rng(3)
    for _ in range(20):
        time = 1e-4 * np.arange(4000)
        distance = 4e-3 + DISTANCE_M * generator.standard_normal(4000)
        current = CURRENT_A * generator.standard_normal(4000)
        track = Track(time, np.zeros(4000, int), distance, current[:, None], DISTANCE_M)
        (rest,) = find_rests(solenoid(), track).rests
        assert (rest.first, rest.last) == (0, 3999)


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


@pytest.mark.nightly
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
