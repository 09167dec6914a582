"""The study's figures: the noise bound, lost loops, Hall bias and force error, on a rig like the paper's."""

import json
from dataclasses import replace

import numpy as np
import pytest

from femfit.model.coordinate import DistanceCoordinate
from femfit.model.hall import HallSpline
from femfit.simulation.design import CONTROLLERS, LoopDesign, design_loop
from femfit.simulation.sensor import amplitude_spectrum
from femfit.simulation.study import closed_loop_study
from support.splines import REFERENCE_DISTANCE, fitted_spline


@pytest.fixture(scope="module")
def study(levitation_model):
    return closed_loop_study(levitation_model, seed=1)


@pytest.mark.nightly
def test_the_steps_compare_direct_measurement_and_filter_for_all_controllers(study):
    rms = {(row.controller, row.measurement): row.rms_m for row in study.steps}
    assert set(rms) == {(c, m) for c in CONTROLLERS for m in ("direct", "ukf")}
    for controller in CONTROLLERS:
        # less than the 5.5 to 6.2 at rest, with the steps' transients in it
        assert rms[controller, "direct"] > 4.5 * rms[controller, "ukf"]
        assert 1e-4 < rms[controller, "direct"] < 2e-4  # the paper's 123 and 157 um of the same noise, 3.2 mV


@pytest.mark.nightly
def test_filters_reach_the_noise_bound_at_both_ends_of_the_range_and_are_consistent(study):
    assert len(study.holds) == 12
    for row in study.holds:
        assert row.held >= 0.95 * row.runs
        assert row.ratio > 5.0
        assert row.ratio == pytest.approx(row.bound, rel=0.18)  # 6 % statistical: 16 runs of ten time constants
        assert abs(row.normalised_innovation_squared - 1.0) < 0.04  # 16 runs of 600
    inside = [row.innovation_band.contains(row.normalised_innovation_squared) for row in study.holds]
    assert sum(inside) >= 10  # each of six independent holds leaves a 95 % band once in twenty
    by_filter = {f: [row.filtered_rms_m for row in study.holds if row.filter == f] for f in ("ukf", "ekf")}
    np.testing.assert_allclose(by_filter["ekf"], by_filter["ukf"], rtol=0.02)


def faults(study, observer, **fields):
    """Rows of a kind of fault."""
    return [
        row
        for row in study.faults
        if row.experiment.observer == observer
        and all(getattr(row.experiment, name) == value for name, value in fields.items())
    ]


@pytest.mark.nightly
def test_without_a_filter_the_body_is_lost_at_once(study):
    raw = faults(study, "direct")
    assert len(raw) == 6
    for row in raw:
        assert row.held == 0
        assert row.last_loss_s < 0.3


@pytest.mark.nightly
@pytest.mark.parametrize("offset", [-0.02, 0.02])
def test_the_fourth_state_holds_a_hall_offset_within_micrometres(study, offset):
    rows = faults(study, "ukf4", offset=offset)
    assert len(rows) == 6
    for row in rows:
        assert row.held >= 0.8 * row.runs
        assert row.shift_error_m < 3e-6
        assert abs(row.position_shift_m) < 5e-6
    assert all("FILTER_DIVERGED" in row.outcomes for row in faults(study, "ukf", offset=0.02))


@pytest.mark.nightly
def test_one_per_cent_of_force_costs_a_tenth_of_a_millimetre(study):
    rows = faults(study, "ukf", force_scale=1.01)
    off = [row.estimate_bias_m for row in rows]
    assert 0.03e-3 < min(off) < max(off) < 0.2e-3
    assert np.mean(off) == pytest.approx(0.10e-3, rel=0.35)
    for row in rows:
        # an integrator puts the estimate on the reference, the regulator's within a third of the body's rate;
        # backstepping has none and is off by more
        factor = {"pid": 1.6, "state-feedback": 4.0, "backstepping": 15.0}[row.experiment.controller]
        assert abs(row.position_bias_m) < factor * row.estimate_bias_m


@pytest.mark.nightly
def test_series_and_spectra_are_there_to_be_drawn(study):
    assert [(s.controller, s.observer) for s in study.series] == [(name, "ukf") for name in CONTROLLERS]
    for series in study.series:
        lengths = {len(getattr(series, name)) for name in ("time_s", "reference_m", "true_m", "direct_m", "voltage_V")}
        assert len(lengths) == 1
        assert np.isfinite(series.true_m).all()
    for pair in study.spectra:
        fast = pair.frequency_Hz > 200.0
        # the filter removes what the body cannot do
        assert pair.filtered_m[fast].mean() < 0.1 * pair.direct_m[fast].mean()


@pytest.mark.nightly
def test_the_study_says_first_which_controllers_hold_and_knows_no_paper(study):
    first, *others = str(study).splitlines()
    assert "backstepping" in first
    assert "pid" in first
    assert not any("paper" in line for line in (first, *others))
    data = json.loads(json.dumps(study.data(), allow_nan=False))
    assert len(data["holds"]) == len(study.holds)


@pytest.mark.nightly
def test_loops_that_are_all_lost_have_no_spectrum_and_no_warning(levitation_model):
    study = closed_loop_study(levitation_model, noise=1.0)  # of the 0.9 V that the magnet moves the output
    assert all(row.held == 0 for row in study.holds)
    assert study.spectra == ()


@pytest.mark.nightly
def test_a_study_says_what_it_lacks_and_tells_no_number_that_there_is_not(study, monkeypatch):
    """A body that is stable has no bound, a controller that was not found a reason, a shift within its error none."""
    row = next(row for row in study.faults if np.isfinite(row.position_shift_m))
    still = replace(row, position_shift_m=123e-12, shift_error_m=190e-12)
    without = replace(study, holds=tuple(replace(one, bound=np.nan) for one in study.holds), faults=(still,))
    monkeypatch.setattr(LoopDesign, "why_no", lambda _, name: "No pid: slow coil." if name == "pid" else "")
    text = str(without)
    assert "No pid: slow coil." in text.partition("Steps")[0]
    assert "nan" not in text
    assert "190 pm" not in text
    assert "body not moved" in text


@pytest.fixture(scope="module")
def turning(levitation_model):
    """A Hall voltage that turns at 36.8 mm, beyond the reference distances: no inversion, but enough for a filter."""
    field = HallSpline(
        DistanceCoordinate(REFERENCE_DISTANCE),
        fitted_spline(lambda d, i: 8.6e-8 / (d + 0.0015) ** 3 + 0.12 * d + 0.005 * i, np.linspace(0.0, 1.4, 8), 1),
    )
    return replace(levitation_model, sensor=replace(levitation_model.sensor, field=field))


@pytest.mark.nightly
def test_a_hall_voltage_that_cannot_be_inverted_leaves_the_filters_study(turning, study):
    alone = closed_loop_study(turning, seed=1)
    assert "it turns at 36.8 mm" in alone.no_direct
    assert not faults(alone, "direct")
    assert alone.spectra == ()
    assert {row.measurement for row in alone.steps} == {"ukf"}
    assert all(row.held == row.runs for row in alone.steps)
    for row, usual in zip(alone.holds, study.holds, strict=True):
        assert np.isnan(row.direct_rms_m)
        # The uneven field costs slope: at 30 mm nearly half of it, and the noise grows so much
        assert usual.filtered_rms_m < row.filtered_rms_m < 2.1 * usual.filtered_rms_m
    assert any("36.8" in line for line in str(alone).splitlines())
    assert not any("nan" in line for line in str(alone).splitlines())
    data = alone.data()
    json.dumps(data, allow_nan=False)
    assert data["no_direct"] == alone.no_direct
    assert study.data()["no_direct"] == ""


def test_what_a_study_must_leave_out_is_known_from_its_design(turning):
    assert "it turns at 36.8 mm" in design_loop(turning).why_no_direct


def test_the_spectrum_of_a_sine_peaks_at_its_amplitude_and_that_of_white_noise_is_flat():
    step = 0.5e-3
    time = step * np.arange(2000)
    record = 0.022 + 3e-5 * np.sin(2 * np.pi * 50.0 * time)[:, None]
    amplitude, frequency = amplitude_spectrum(record), np.fft.rfftfreq(len(record), step)
    peak = int(np.argmax(amplitude))
    assert frequency[peak] == pytest.approx(50.0)
    assert amplitude[peak] == pytest.approx(3e-5, rel=2e-3)  # np.hanning is symmetric: 1/2000
    noise = np.random.default_rng(0).normal(0.0, 1e-4, (1000, 200))
    amplitude = amplitude_spectrum(noise)[3:-3]
    halves = amplitude[: len(amplitude) // 2].mean(), amplitude[len(amplitude) // 2 :].mean()
    assert halves[0] == pytest.approx(halves[1], rel=0.02)  # 250 bins of 200 runs
