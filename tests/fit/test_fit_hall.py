"""The Hall characteristic: coil part and magnet part apart from each other."""

import numpy as np
import pytest

from femfit.core.errors import FitError
from femfit.fit.rows import rows_of_table
from femfit.fit.sensed_field import fit_hall
from support.sweeps import MASS, ClosedForm, full_table

TRUTH = ClosedForm()


def test_coil_and_magnet_part_come_apart_and_hold_between_the_rows():
    rows = rows_of_table(full_table(TRUTH), MASS, 9.80665)
    fit = fit_hall(rows, rows.hall)
    d, i = np.meshgrid(np.linspace(0.0152, 0.0448, 31), np.linspace(0.05, 1.35, 9))
    # The basis is chosen for 2e-5 of the range on held-out rows, rms; ten times that at most.
    np.testing.assert_allclose(fit.field.field(d, i), TRUTH.hall(d, i), atol=2e-4 * np.ptp(rows.hall))
    assert fit.rms_T < 1e-4 * np.ptp(rows.hall)
    assert fit.max_T >= fit.rms_T
    assert fit.coil_slope_T_per_A[0] == pytest.approx(3.9e-3, rel=2e-3)
    assert fit.magnet_field_T == pytest.approx((TRUTH.hall(0.045, 0.0), TRUTH.hall(0.015, 0.0)), abs=2e-6)
    assert fit.field.spline.y_degree == 1


def test_a_field_that_is_quadratic_in_the_current_takes_a_parabola():
    rows = rows_of_table(full_table(TRUTH), MASS, 9.80665)
    fit = fit_hall(rows, rows.hall + 1e-3 * rows.current**2)
    assert fit.field.spline.y_degree == 2


def test_noise_does_not_buy_cells():
    rows = rows_of_table(full_table(TRUTH), MASS, 9.80665)
    noisy = rows.hall + 1e-4 * np.random.default_rng(0).standard_normal(len(rows.hall))
    fit = fit_hall(rows, noisy)
    assert fit.field.spline.coefficients.size <= 24
    np.testing.assert_allclose(fit.field.field(rows.distance, rows.current), rows.hall, atol=1e-4)


def test_one_current_cannot_tell_the_coil_from_the_magnet():
    rows = rows_of_table(full_table(TRUTH, currents=[0.4]), MASS, 9.80665)
    with pytest.raises(FitError, match="at least two currents"):
        fit_hall(rows, rows.hall)
