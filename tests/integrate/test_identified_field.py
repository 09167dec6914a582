"""The field of a current, identified: coefficients of its own kind come back, the bounds hold."""

import numpy as np
import pytest

from femfit.core.errors import FitError
from femfit.integrate.field_of_current import FieldTerms, LabRun, field_columns, identify_field, play_paths, precycled

TERMS = FieldTerms(320.0, 3, (20.0, 80.0), (10.0,))
TRUTH = np.array([0.6, 0.7, 0.1, 0.02, 1e-5, 4e-6, 8e-6, 3e-6, 5e-6, 2e-6, 4e-7])


def lab_run(peaks, rng=None, coefficients=TRUTH):
    """Up to each peak and back to zero at 32 A/s, with plateaus of 20 s; 100 samples a second."""
    knots = np.cumsum([0.0, *(part for peak in peaks for part in (peak / 32.0, 20.0, peak / 32.0, 20.0))])
    time = np.arange(round(knots[-1] * 100)) / 100.0
    current = np.interp(time, knots, [0.0, *(value for peak in peaks for value in (peak, peak, 0.0, 0.0))])
    field = field_columns(TERMS, precycled(TERMS), time, current)[1] @ coefficients
    return LabRun(time, current, field if rng is None else field + 1e-6 * rng.normal(size=len(field)))


def test_a_play_operator_lags_by_its_radius_and_wipes_minor_loops_out():
    path = np.array([0.0, 100.0, 60.0, 90.0, 100.0, 0.0, 50.0])
    played = play_paths(np.array([10.0]), np.array([0.0]), path)[:, 0]
    np.testing.assert_array_equal(played, [0.0, 90.0, 70.0, 80.0, 90.0, 10.0, 40.0])


def test_a_cycled_magnet_repeats_its_loop():
    field = lab_run([320.0, 320.0], coefficients=np.r_[TRUTH[:-1], 0.0]).field
    half = len(field) // 2
    np.testing.assert_allclose(field[half:], field[:half], atol=1e-14)


def test_coefficients_of_its_own_kind_come_back():
    rng = np.random.default_rng(1)
    model = identify_field([lab_run([320.0, 240.0, 120.0, 60.0, 320.0], rng)], TERMS)
    # 1 uT of white noise over 10 samples a row and 1300 rows. Plays at full current act on few rows and look like the
    # polynomial there: 1 % of them, 2e-8 T/A, over 100 A.
    np.testing.assert_allclose(model.coefficients[:4], TRUTH[:4], atol=6e-6)
    np.testing.assert_allclose(model.coefficients[4:], TRUTH[4:], rtol=0.04)
    assert model.rms_T == pytest.approx(1e-6 / np.sqrt(10.0), rel=0.1)


def test_strengths_are_never_negative():
    wrong_way = TRUTH * np.r_[np.ones(4), -np.ones(7)]
    model = identify_field([lab_run([320.0, 120.0], coefficients=wrong_way)], TERMS)
    assert np.all(model.coefficients[4:] >= 0.0)


@pytest.mark.parametrize("peaks", [[320.0], [320.0, 200.0]])
def test_few_cycles_are_fitted_where_they_leave_strengths_open(peaks):
    run = lab_run(peaks, np.random.default_rng(3))
    model = identify_field([run])
    assert len(model.coefficients) == 8 + 3 * 7 + 3
    field = model.advance(precycled(model.terms), run.time, run.current)[1]
    # Other radii than the truth's, but the same cycles: within the 1 uT of noise and ten times that at corners.
    assert np.sqrt(np.mean((field - run.field) ** 2)) < 1e-5


def test_the_error_is_that_on_stretches_left_out():
    rng = np.random.default_rng(2)
    runs = [lab_run(peaks, rng) for peaks in ([320.0, 240.0], [320.0, 120.0], [320.0, 60.0])]
    moved = runs[2]._replace(field=runs[2].field + 1e-3)
    assert identify_field([*runs[:2], moved], TERMS).rms_T > 3e-4
    assert identify_field(runs, TERMS).rms_T < 1e-6


@pytest.mark.parametrize(("amplitude", "words"), [(0.0, "> 0 A"), (2.0, "one polarity")])
def test_a_run_without_current_or_of_both_polarities_is_refused(amplitude, words):
    time = np.arange(5000) / 100.0
    current = amplitude * np.sin(time)
    with pytest.raises(FitError, match=words):
        identify_field([LabRun(time, current, 0.1 * current)])


def test_a_run_too_short_to_foresee_its_own_stretches_is_refused():
    time, rng = np.arange(400) / 100.0, np.random.default_rng(3)
    current = 320.0 * np.clip(2.0 * (time - 1.0), 0.0, 1.0)
    noisy = current / 320.0 + 1e-3 * rng.normal(size=400)
    with pytest.raises(FitError, match="several cycles"):
        identify_field([LabRun(time, current + 1e-4 * rng.normal(size=400), noisy)])
