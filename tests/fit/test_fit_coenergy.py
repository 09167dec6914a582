"""The co-energy fit on closed forms: force, flux linkage, k_m and L from one function."""

import numpy as np
import pytest

from femfit.core.errors import FitError, UsageError
from femfit.fit.coenergy import SHAPES, fit_coenergy, obeyed_shapes
from femfit.fit.coenergy_system import held_out_masks
from femfit.fit.rows import rows_of_table
from femfit.tables.sweep_table import SweepTable
from support.sweeps import CURRENTS, DISTANCES, MASS, ClosedForm, force_table, full_table, grid

G = 9.80665
TRUTH = ClosedForm()
BETWEEN = np.meshgrid(np.linspace(0.0152, 0.0448, 23), np.linspace(0.03, 1.37, 17))
"""Points that are no rows of the sweep."""


@pytest.fixture(scope="module")
def fit(closed_form_fit):
    return closed_form_fit.coenergy


def relative_rms(value, truth):
    return float(np.sqrt(np.mean((value / truth - 1.0) ** 2)))


def test_force_flux_motional_constant_and_inductance_follow_the_closed_form_between_the_rows(fit):
    d, i = BETWEEN
    m = fit.magnetics
    # The issue asks for 0.1 %; the basis is chosen for 5e-5 on held-out forces, derivatives lose a factor of a few.
    assert relative_rms(m.force(d, i), TRUTH.force(d, i)) < 1e-4
    assert np.sqrt(np.mean((m.force(d, i) - TRUTH.force(d, i)) ** 2)) < 2e-4 * MASS * G
    assert relative_rms(m.flux_linkage(d, i), TRUTH.flux_linkage(d, i)) < 1e-4
    assert relative_rms(m.motional_constant(d, i), TRUTH.motional_constant(d, i)) < 8e-4
    assert relative_rms(m.inductance(d, i), TRUTH.inductance(d, i)) < 5e-4


def test_reciprocity_is_exact(fit):
    d, i = BETWEEN
    step = 1e-5
    slope = (fit.magnetics.flux_linkage(d + step, i) - fit.magnetics.flux_linkage(d - step, i)) / (2 * step)
    # Central differences of order two: 1e-6 is their own error.
    np.testing.assert_allclose(-slope, fit.magnetics.motional_constant(d, i), rtol=1e-5)


def test_coenergy_vanishes_without_current_at_the_largest_distance(fit):
    assert abs(fit.magnetics.coenergy(np.array(0.045), np.array(0.0))) < 1e-18


def test_a_linear_winding_needs_one_parabola_in_the_current(fit):
    assert fit.basis.current_degree == 2
    assert fit.basis.cells[1] == 1
    assert fit.basis.shape[0] * fit.basis.shape[1] <= 40


def test_a_saturating_winding_takes_more_of_the_current():
    truth = ClosedForm(saturation=0.8)
    currents = np.linspace(0.0, 1.4, 15)
    fit = fit_coenergy(rows_of_table(full_table(truth, currents=currents, distances=DISTANCES[::3]), MASS, G))
    assert fit.basis.current_degree > 2
    d, i = BETWEEN
    assert relative_rms(fit.magnetics.force(d, i), truth.force(d, i)) < 1e-3
    assert relative_rms(fit.magnetics.flux_linkage(d, i), truth.flux_linkage(d, i)) < 1e-3
    assert relative_rms(fit.magnetics.inductance(d, i), truth.inductance(d, i)) < 0.02


def test_flux_linkage_makes_the_motional_constant_better_than_force_alone_under_noise():
    table = full_table(TRUTH)
    rng = np.random.default_rng(4)
    table.rows["force_error_N"] = 2e-3 * table.rows["force_N"]
    table.rows["force_N"] += table.rows["force_error_N"] * rng.standard_normal(len(table.rows))
    table.rows["flux_linkage_Wb"] += 2e-7 * rng.standard_normal(len(table.rows))
    both = fit_coenergy(rows_of_table(table, MASS, G)).magnetics
    table.rows["flux_linkage_Wb"] = np.nan
    alone = fit_coenergy(rows_of_table(table, MASS, G)).magnetics
    d, i = BETWEEN
    k_m = TRUTH.motional_constant(d, i)
    assert relative_rms(both.motional_constant(d, i), k_m) < 0.5 * relative_rms(alone.motional_constant(d, i), k_m)


def test_force_alone_gives_the_motional_constant_and_a_declared_inductance_at_the_largest_distance():
    rows = rows_of_table(force_table(TRUTH.force), MASS, G)
    fit = fit_coenergy(rows, open_inductance_H=16e-3)
    d, i = BETWEEN
    assert relative_rms(fit.magnetics.motional_constant(d, i), TRUTH.motional_constant(d, i)) < 2e-3
    end = np.array(0.045)
    assert fit.magnetics.inductance(end, np.array(0.7)) == pytest.approx(16e-3, rel=1e-9)
    # What the force tells is the change of inductance with distance: L_1 (exp(-d/h) - exp(-d_max/h)).
    change = TRUTH.inductance(d, i) - TRUTH.inductance(end, np.array(0.7))
    np.testing.assert_allclose(fit.magnetics.inductance(d, i) - 16e-3, change, atol=3e-5)


def test_shapes_that_the_rows_obey_are_imposed_by_default(fit):
    assert fit.constraints == ("inductance", "decreasing", "attracting")
    assert fit.active == ()


def test_a_shape_that_the_rows_break_is_not_imposed():
    rows = rows_of_table(full_table(ClosedForm(b=-1e-6, L_1=0.0)), MASS, G)
    assert obeyed_shapes(rows) == ["inductance", "decreasing"]
    rising = force_table(lambda d, i: 1.0 + d - 0.1 * i)
    assert obeyed_shapes(rows_of_table(rising, MASS, G)) == []


def test_a_declared_shape_holds_where_noise_would_break_it_and_says_where_it_acts():
    # A coil that hardly pulls: noise turns k_m negative in places unless it is declared not to be.
    truth = ClosedForm(b=1e-8, L_1=0.0)
    table = full_table(truth)
    rng = np.random.default_rng(8)
    table.rows["force_N"] += 2e-5 * rng.standard_normal(len(table.rows))
    table.rows["flux_linkage_Wb"] += 1e-6 * rng.standard_normal(len(table.rows))
    rows = rows_of_table(table, MASS, G)
    d, i = BETWEEN
    assert np.min(fit_coenergy(rows, constraints=()).magnetics.motional_constant(d, i)) < 0
    fit = fit_coenergy(rows, constraints=("attracting",))
    points = fit.magnetics.motional_constant(*grid(distances=DISTANCES, currents=CURRENTS)[::-1])
    # Imposed at 25 points of the axis: between them a quartic may dip by a fraction of a per cent.
    assert np.min(points) > -5e-3 * np.max(points)
    assert fit.active
    assert all(words.startswith(SHAPES["attracting"]) and " mm, " in words for words in fit.active)


def test_unknown_shapes_list_the_known_ones():
    with pytest.raises(UsageError, match="inductance, decreasing, attracting; instead received rising"):
        fit_coenergy(rows_of_table(full_table(), MASS, G), constraints=("rising",))


@pytest.mark.parametrize("currents", [[0.2], [0.0, 0.2]])
def test_too_few_currents_are_refused_with_what_to_do(currents):
    with pytest.raises(FitError, match=r"needs at least 3 currents and 5 distances.*Sweep more currents"):
        fit_coenergy(rows_of_table(full_table(currents=currents), MASS, G))


def test_held_out_rows_keep_the_ends_of_both_axes():
    rows = rows_of_table(full_table(), MASS, G)
    for mask in held_out_masks(rows):
        kept = rows.take(~mask)
        assert kept.distances[[0, -1]].tolist() == rows.distances[[0, -1]].tolist()
        assert kept.currents[[0, -1]].tolist() == rows.currents[[0, -1]].tolist()


def test_a_force_without_current_is_fitted_where_it_is_zero():
    # A plunger without a magnet: F = 0 at i = 0, so errors relative to the force do not exist there.
    truth = ClosedForm(a=0.0, b=0.0, L_1=20e-3)
    fit = fit_coenergy(rows_of_table(full_table(truth), MASS, G))
    d, i = BETWEEN
    np.testing.assert_allclose(fit.magnetics.force(d, i), truth.force(d, i), atol=1e-4 * np.max(truth.force(d, i)))


def plunger(distances, currents, gap=0.0095):
    """A table of F = i^2 dL/dd / 2 with L = L_0 + L_1 g / (d + g), g the pole's own gap, and what leaks beside it."""

    def inductance(d, slope=False):
        if slope:
            return -0.02 * gap / (d + gap) ** 2 - 0.004 / 0.006 * np.exp(-d / 0.006)
        return 0.02 + 0.02 * gap / (d + gap) + 0.004 * np.exp(-d / 0.006)

    def force(d, i):
        return -0.5 * i**2 * inductance(d, slope=True)

    table = force_table(force, currents, distances)
    table.rows["flux_linkage_Wb"] = inductance(table.rows["distance_m"]) * table.rows["current_A"]
    return table, force


def test_a_plunger_with_a_gap_of_its_own_is_met_from_nine_distances():
    # Nine distances over a ratio of nine crowd in d_0 / d: without the shift the force is missed by per cents.
    table, force = plunger(np.linspace(1e-3, 9e-3, 9), [0.0, 0.5, 1.0, 1.5])
    fit = fit_coenergy(rows_of_table(table, None, G))
    d, i = np.meshgrid(np.linspace(1.1e-3, 8.9e-3, 31), [0.3, 0.8, 1.4])
    assert relative_rms(fit.magnetics.force(d, i), force(d, i)) < 1e-3
    assert fit.held_out < 1e-3
    assert fit.basis.coordinate.distance_shift_m > 0


def test_flux_linkage_beside_the_force_makes_six_distances_enough():
    table, force = plunger(np.array([1.0, 2.0, 3.5, 5.0, 7.0, 9.0]) * 1e-3, [-1.0, 0.0, 1.0])
    fit = fit_coenergy(rows_of_table(table, None, G))
    d, i = np.meshgrid(np.linspace(1.1e-3, 8.9e-3, 31), [-0.6, 0.7])
    # Six distances: what a quartic leaves of an exponential and a pole between them.
    assert relative_rms(fit.magnetics.force(d, i), force(d, i)) < 5e-3


def test_a_force_that_changes_its_sign_along_the_way_is_fitted_through_zero():
    # A magnet through a coil: no force at the middle for any current, where a relative error means nothing.
    table = force_table(
        lambda d, i: 20.0 * i * (d - 0.016) * np.exp(-(((d - 0.016) / 0.008) ** 2)),
        [-1.0, 0.0, 1.0, 2.0],
        np.linspace(1e-3, 31e-3, 31),
    )
    rows = rows_of_table(table, None, G)
    fit = fit_coenergy(rows)
    error = fit.magnetics.force(rows.distance, rows.current) - rows.force
    assert np.sqrt(np.mean(error**2)) < 1e-3 * np.sqrt(np.mean(rows.force**2))
    middle = np.isclose(rows.distance, 0.016)
    # A hundredth of the lower one of the lobes on both sides, which are alike here.
    np.testing.assert_allclose(rows.force_scale[middle], 0.01 * np.max(np.abs(rows.force)))


def test_a_column_without_a_full_grid_is_refused_before_numbers_are_made_up():
    table = full_table(currents=[0.0, 0.7, 1.4])
    keep = (table.rows["current_A"] == 0.0) | (table.rows["distance_m"] > 0.0446)
    with pytest.raises(FitError, match="do not determine"):
        fit_coenergy(rows_of_table(SweepTable(table.rows[keep], table.manifest), MASS, G))
