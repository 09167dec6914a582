"""Feed-forward and one-state integrators: online as offline, closed forms, the paper's figures."""

from dataclasses import replace

import numpy as np
import pytest
from arpaia2022.kalman import KalmanIntegrator
from arpaia2022.sensors import PAPER_COIL, paper_noise

from femfit.core.errors import TableError
from femfit.integrate.feed_forward import FeedForwardIntegrator
from femfit.integrate.uncertainty import LinearSigma, Noise, SensingCoil
from femfit.tables.coil_record import CoilBlock
from support.field_blocks import run

DT = 1e-3
QUIET = Noise(LinearSigma(1e-6), LinearSigma(1e-5), 1e-3)
INTEGRATORS = {
    "trapezoid": FeedForwardIntegrator(PAPER_COIL, QUIET, DT),
    "ffa1": FeedForwardIntegrator(PAPER_COIL, QUIET, DT, zero_reading=0.2, window=0.05),
    "ffa2": FeedForwardIntegrator(PAPER_COIL, QUIET, DT, on_plateaus=True, settling=0.1, window=0.05),
    "cs1": KalmanIntegrator(PAPER_COIL, QUIET, DT),
    "cs2": KalmanIntegrator(PAPER_COIL, QUIET, DT, current_to_field=316.0, initial_field=0.0),
}


@pytest.fixture(scope="module")
def stretch(experiment):
    """Two seconds around the first ramp."""
    first = int(59.5 / DT)
    return experiment.record[first : first + 5000]


@pytest.mark.parametrize("name", INTEGRATORS)
@pytest.mark.parametrize("cuts", [tuple(range(1, 5000)), (1, 130, 131, 3000)], ids=["sample by sample", "blocks"])
def test_online_gives_the_numbers_of_offline(name, cuts, stretch):
    whole, pieces = run(INTEGRATORS[name], stretch), run(INTEGRATORS[name], stretch, cuts)
    for column in ("field", "variance", "offset", "innovation", "innovation_variance"):
        expected = getattr(whole, column)
        # Rounding of 5000 additions of numbers of order one.
        scale = np.nanmax(np.abs(expected), initial=1e-30)
        np.testing.assert_allclose(getattr(pieces, column), expected, rtol=1e-9, atol=1e-12 * scale)
    for part in ("coil", "reference", "reference_unit", "voltage_unit"):
        np.testing.assert_allclose(getattr(pieces.responses, part), getattr(whole.responses, part), atol=1e-10)


def test_trapezoid_drifts_by_offset_over_area():
    time = np.arange(10_001) * DT
    block = run(INTEGRATORS["trapezoid"], CoilBlock(time, np.full(len(time), 7e-6)))
    # Exact but for the rounding of 1e4 sums.
    assert block.field[-1] == pytest.approx(7e-6 * 10.0 / 0.059394, rel=1e-10)


def test_an_area_of_one_gives_the_flux_linkage():
    time = np.arange(1001) * DT
    integrator = FeedForwardIntegrator(SensingCoil(1.0), QUIET, DT)
    assert run(integrator, CoilBlock(time, np.sin(time))).field[-1] == pytest.approx(1.0 - np.cos(1.0), rel=1e-6)


def test_the_variance_of_the_integral_is_that_of_its_samples():
    rng = np.random.default_rng(3)
    time = np.arange(400) * DT
    ends = [run(INTEGRATORS["trapezoid"], CoilBlock(time, 1e-6 * rng.normal(size=400))) for _ in range(800)]
    spread = np.var([block.field[-1] for block in ends])
    # 800 repeats give a variance within 5 % (one standard deviation); (11) would give half of it.
    assert spread == pytest.approx(ends[0].variance[-1], rel=0.15)


def test_zero_reading_holds_the_field_and_removes_a_constant_offset():
    time = np.arange(2000) * DT
    block = run(INTEGRATORS["ffa1"], CoilBlock(time, np.full(2000, 7e-6)))
    assert np.all(block.field[:200] == 0.0)
    assert block.offset[-1] == pytest.approx(7e-6)
    assert abs(block.field[-1]) < 1e-15


@pytest.mark.parametrize("with_current", [True, False])
def test_plateau_mean_is_not_updated_on_ramps_and_while_eddy_currents_decay(experiment, with_current):
    record = experiment.record
    if not with_current:
        record = CoilBlock(record.time, record.voltage)
    block = run(FeedForwardIntegrator(PAPER_COIL, QUIET, DT, on_plateaus=True, settling=30.0), record)
    begin, end = experiment.flat_tops[0]
    waiting = (block.time > 61.1) & (block.time < begin + 30.0)
    assert len(np.unique(block.offset[waiting])) == 1
    updates = np.flatnonzero(np.diff(block.offset) != 0.0) + 1
    updates = updates[(block.time[updates] > begin + 30.0) & (block.time[updates] < end)]
    assert len(updates) >= 25
    for k in updates:
        # What it must be: the offset, and what supply and eddy currents still move the field by. 35 nV of noise.
        moved = 0.059394 * (experiment.field[k - 1] - experiment.field[k - 1000])
        assert block.offset[k] == pytest.approx(np.mean(experiment.offset[k - 1000 : k]) + moved, abs=0.15e-6)


def test_literal_filter_has_the_papers_uncertainty_at_its_sample_rate():
    samples = 2**20
    integrator = KalmanIntegrator(PAPER_COIL, paper_noise(True), 1.0 / 204.8e3)
    time = np.arange(samples) / 204.8e3
    state, _ = integrator.advance(integrator.start(), CoilBlock(time, np.zeros(samples), np.full(samples, 1.012)))
    # Table 3 prints 65 uT; ERRATA's closed form is 65.6.
    assert 2e6 * np.sqrt(state.variance) == pytest.approx(65.6, abs=0.1)


def test_literal_uncertainty_at_one_thousandth_of_a_second_is_938_microtesla():
    integrator = KalmanIntegrator(PAPER_COIL, paper_noise(True), DT)
    time = np.arange(20_000) * DT
    state, _ = integrator.advance(integrator.start(), CoilBlock(time, np.zeros(20_000), np.full(20_000, 1.012)))
    assert 2e6 * np.sqrt(state.variance) == pytest.approx(938.0, abs=2.0)


def test_one_state_lags_by_offset_times_time_constant_over_area():
    noise = paper_noise(True, 1.0 / DT)
    time = np.arange(20_000) * DT
    block = run(
        KalmanIntegrator(PAPER_COIL, noise, DT),
        CoilBlock(time, np.full(20_000, 7e-6), np.full(20_000, 1.0)),
    )
    gain = block.variance[-1] / noise.reference.variance(np.array(1.0))
    # tau = T_s (1 - K) / K at rest, exactly; ERRATA says 44 uT.
    assert block.field[-1] - 1.0 == pytest.approx(7e-6 * DT * (1 - gain) / gain / 0.059394, rel=1e-6)
    assert block.field[-1] - 1.0 == pytest.approx(44e-6, abs=1e-6)
    assert block.offset[-1] == pytest.approx(7e-6, rel=1e-3)
    assert block.responses.voltage_unit[-1] * 7e-6 == pytest.approx(block.field[-1] - 1.0, rel=1e-6)


def test_settled_filter_answers_to_the_probe_and_not_to_the_coil():
    time = np.arange(20_000) * DT
    integrator = KalmanIntegrator(PAPER_COIL, paper_noise(True, 1.0 / DT), DT)
    answers = run(integrator, CoilBlock(time, np.zeros(20_000), np.full(20_000, 1.0))).responses
    # 20 s are 50 time constants.
    assert answers.reference[-1] == pytest.approx(1.0, abs=1e-9)
    assert answers.reference_unit[-1] == pytest.approx(1.0, abs=1e-9)
    assert abs(answers.coil[-1]) < 1e-9


@pytest.mark.parametrize("part", ["coil", "reference", "voltage"])
def test_sensitivities_are_those_of_a_changed_record(part, experiment):
    record = experiment.record[60_000:70_000]
    integrator = KalmanIntegrator(PAPER_COIL, QUIET, DT, initial_field=2.27e-3)
    base, small = run(integrator, record), 1e-3
    changes = {
        "coil": CoilBlock(record.time, record.voltage * (1 + small), record.hall),
        "reference": CoilBlock(record.time, record.voltage, record.hall * (1 + small)),
        "voltage": CoilBlock(record.time, record.voltage + small, record.hall),
    }
    moved = (run(integrator, changes[part]).field - base.field) / small
    told = base.responses.voltage_unit if part == "voltage" else getattr(base.responses, part)
    # Linear, so that only rounding is left: 1e-16 of 1 T over a change of 1e-3.
    np.testing.assert_allclose(told, moved, atol=1e-9 * max(1.0, float(np.abs(told).max())))


def test_missing_readings_leave_the_prediction(stretch):
    hall = stretch.hall.copy()
    hall[100:400] = np.nan
    block = run(INTEGRATORS["cs1"], CoilBlock(stretch.time, stretch.voltage, hall))
    assert np.all(np.isfinite(block.field))
    assert np.all(np.isnan(block.innovation[100:400]))
    assert np.all(np.diff(block.variance[99:400]) > 0)


def test_a_gap_costs_the_certainty_that_it_may_hide():
    time = np.r_[np.arange(1000), np.arange(1500, 2000)] * DT
    voltage = np.full(1500, 1e-2)
    block = run(INTEGRATORS["trapezoid"], CoilBlock(time, voltage))
    hidden = 1e-2 * 0.501 / 0.059394
    # The noise of 1500 samples is 1e-6 of what the gap hides.
    assert np.sqrt(block.variance[-1]) == pytest.approx(hidden, rel=1e-4)


@pytest.mark.parametrize("area", [0.0, -0.1, np.nan, np.inf])
def test_an_area_that_is_not_positive_is_refused(area):
    with pytest.raises(TableError, match="area must be > 0 m2"):
        SensingCoil(area)


def test_a_record_without_the_reference_is_refused():
    record = CoilBlock(np.arange(3) * DT, np.zeros(3))
    for name, column in (("cs1", "hall_T"), ("cs2", "current_A")):
        with pytest.raises(TableError, match=f"needs {column}"):
            run(INTEGRATORS[name], record)


def test_plateaus_are_told_at_the_papers_sample_rate():
    # White noise of 0.064 A at 204.8 kS/s, whose extremes in a second are 0.6 A apart, about a limit of 0.1 A.
    rate, rng = 204.8e3, np.random.default_rng(6)
    time = np.arange(round(2.5 * rate)) / rate
    current = np.where(time < 1.0, 320.0, 320.0 - 3.2 * (time - 1.0)) + 0.064 * rng.normal(size=len(time))
    record = CoilBlock(time, np.full(len(time), 7e-6), None, current)
    integrator = FeedForwardIntegrator(PAPER_COIL, QUIET, 1.0 / rate, on_plateaus=True, settling=0.0)
    state, on_plateau = integrator.advance(integrator.start(), record[: round(1.2 * rate)])
    # The mean of the first second holds from there on; the ramp after it is no plateau.
    assert on_plateau.offset[-1] == pytest.approx(7e-6)
    state, on_ramp = integrator.advance(state, record[round(1.2 * rate) :])
    assert len(np.unique(on_ramp.offset)) == 1
    assert state.still == 0.0


@pytest.mark.parametrize("cuts", [tuple(range(1, 5000)), (1, 130, 131, 3000)], ids=["sample by sample", "blocks"])
def test_plateaus_are_told_online_as_offline_where_samples_are_averaged(cuts, stretch):
    fast = CoilBlock(stretch.time / 7.0, stretch.voltage, None, stretch.current)
    integrator = replace(INTEGRATORS["ffa2"], sample_time=DT / 7.0)
    whole = run(integrator, fast)
    assert 1 < len(np.unique(whole.offset)) < 20
    np.testing.assert_allclose(run(integrator, fast, cuts).offset, whole.offset, rtol=1e-9)
