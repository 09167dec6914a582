"""Eddy currents of a sweep in its model: how many states, how far off, and passive everywhere."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from femfit.core.errors import FitError
from femfit.fit.eddy import _entries, _splines, as_table, conductivities, fit_eddy
from femfit.fit.eddy_states import StateChoice
from femfit.model.bspline import DistanceCoordinate, basis_matrix
from femfit.model.magnetics import MagneticState
from femfit.tables.eddy_table import EddyTable
from support.impedances import changed_impedance

CIRCUITS = ("coil",)
DISTANCES = np.linspace(1e-3, 4e-3, 7)
FREQUENCIES = np.geomspace(1.0, 1e4, 9)


@cache
def made_up(patterns=12, hall=True, circuits=1, seed=1):
    """Windings whose co-energy is a positive form at each distance, with its exact slopes."""
    rng = np.random.default_rng(seed)
    count = circuits + patterns
    size = np.concatenate([np.full(circuits, 0.3), 0.1 * 0.45 ** np.arange(patterns)])
    base = np.diag(size**2) + 0.8 * np.outer(size, size) * 0.5
    drift = 0.2 * rng.normal(size=(count, count)) * np.outer(size, size) * 0.1
    magnet = 0.05 * size
    flux, force = [], []
    for d in DISTANCES:
        x, slope = 1e-3 / (d + 1e-3), -1e-3 / (d + 1e-3) ** 2
        form, rise = base * (1.0 + x) + x * (drift + drift.T), slope * (base + drift + drift.T)
        whole = np.block([[np.zeros((1, 1)), x * magnet[None]], [x * magnet[:, None], form]])
        change = np.block([[np.zeros((1, 1)), slope * magnet[None]], [slope * magnet[:, None], rise]])
        flux.append(whole[1:])
        force.append(-0.5 * change)
    seen = np.tile(np.concatenate([[0.01], size]), (len(DISTANCES), 1)) if hall else None
    return EddyTable(
        circuits=CIRCUITS[:circuits],
        distances_m=DISTANCES,
        frequencies_Hz=FREQUENCIES,
        force=np.array(force),
        flux_linkage=np.array(flux),
        hall=seen,
        checked_Hz=FREQUENCIES,
        errors=np.zeros((len(FREQUENCIES), 3)),
        braking_error=0.0,
        materials=("iron", "copper"),
        conductivities_S_per_m=np.array([5e6, 58e6]),
        resistances=np.array([np.diag(np.linspace(0.1, 0.9, patterns)), np.diag(np.linspace(0.9, 0.1, patterns))]),
        asked_error=0.01,
    )


class Plain:
    """Magnetics whose splines follow the distance itself."""

    coordinate = DistanceCoordinate(1e-3, 1e-3)


@pytest.fixture(scope="module")
def within_a_hundredth():
    return fit_eddy(made_up(), Plain(), 0.01)


@pytest.mark.parametrize("error", [0.1, 0.001])
def test_the_error_that_is_asked_for_is_met_with_fewer_states_where_it_is_larger(within_a_hundredth, error):
    table = made_up()
    eddy = fit_eddy(table, Plain(), error)
    assert eddy.error.largest <= 1.01 * error
    assert eddy.count <= {0.1: 4, 0.001: 9}[error]
    assert within_a_hundredth.error.largest <= 1.01 * 0.01
    assert within_a_hundredth.count <= 6


def test_the_hall_field_of_the_states_is_the_one_that_fits_best():
    table = made_up()
    choice = StateChoice(table, FREQUENCIES)
    found = choice.table(0.02)
    held = table.patterns  # what the same combinations of the patterns' own Hall fields would be off
    projected = table.combined(choice._combinations(0.02))
    assert found.patterns == projected.patterns < held
    off = np.zeros((2, len(DISTANCES)))
    for k in range(len(DISTANCES)):
        exact = table.transfers(k, FREQUENCIES)
        off[:, k] = [one.transfers(k, FREQUENCIES).departures(exact)[:, 2].max() for one in (found, projected)]
    assert off[0].max() <= 0.02
    assert off[0].max() < 0.7 * off[1].max()
    assert found.flux_linkage == pytest.approx(projected.flux_linkage)  # and the energy is what it was


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("kept", [(0, 3, 6), (0, 2, 4, 6), (0, 1, 4, 6), (0, 2, 3, 5, 6)])
def test_the_stated_error_holds_what_the_splines_miss_between_the_distances(kept, seed):
    table = made_up(patterns=4, seed=seed)
    fewer, left = table.at(np.array(kept)), [k for k in range(len(DISTANCES)) if k not in kept]
    magnetics = Plain()
    magnetics.coordinate = DistanceCoordinate(1e-3, kind="distance")  # in which the field bends
    eddy = fit_eddy(fewer, magnetics, 1e-9)
    model = as_table(eddy, table)
    off = [model.transfers(k, FREQUENCIES).departures(table.transfers(k, FREQUENCIES)) for k in left]
    told = np.array([eddy.error.impedance, eddy.error.force, eddy.error.hall]) / np.max(off, axis=(0, 1))
    assert (told > 0.4).all()
    assert (told < 10.0).all()  # a force's slope happens to be missed by little half-way


def test_as_many_states_are_kept_as_the_patterns_or_the_motion_need():
    assert fit_eddy(made_up(patterns=3), Plain(), 1e-9).count == 3
    table = made_up(patterns=1)
    eddy = fit_eddy(table, Plain(), 0.01)
    assert eddy.count == 1
    assert eddy.error.largest < 1e-3
    table = made_up(circuits=0, hall=False)
    eddy = fit_eddy(table, Plain(), 0.02)
    assert eddy.couplings.shape[1] == 0
    assert 1 <= eddy.count < 12
    assert fit_eddy(None, Plain()) is None


@pytest.mark.parametrize("frequency", [100.0, 1e-5])
def test_one_frequency_is_a_range(frequency):
    only = np.array([max(frequency, 1e-3)])  # the least that the field is solved at
    table = replace(made_up(), frequencies_Hz=np.array([frequency]), checked_Hz=only, errors=np.zeros((1, 3)))
    eddy = fit_eddy(table, Plain(), 0.01)
    assert (eddy.error.frequency_min_Hz, eddy.error.frequency_max_Hz) == (only[0], only[0])
    change = conductivities(table, eddy)[0].impedance
    d, f = DISTANCES[[1, 4]], np.full(2, only[0])
    got = changed_impedance(change, d, np.zeros(2), f, {change.parameter: np.expm1(-0.5)})
    slope, bend = np.array([table.conductivity_changes(0, k, only) for k in (1, 4)])[:, :, 0, 0, 0].T
    np.testing.assert_allclose(got.ravel(), -0.5 * slope + 0.125 * bend, rtol=1e-9)


def test_between_the_distances_splines_keep_their_own_slopes_and_stay_positive(within_a_hundredth):
    eddy = within_a_hundredth  # what the drawing asks for
    assert fit_eddy(made_up(patterns=3), Plain()).error == fit_eddy(made_up(patterns=3), Plain(), 0.01).error
    fine = np.linspace(DISTANCES[0], DISTANCES[-1], 101)
    here, slope = eddy.forms(fine, 0, 1)
    assert np.linalg.eigvalsh(here.inductance).min() > 0.0
    step = 1e-8
    above, below = (eddy.forms(fine + side * step)[0] for side in (1.0, -1.0))
    assert (above.inductance - below.inductance) / (2 * step) == pytest.approx(slope.inductance, rel=1e-4, abs=1e-9)


def test_beside_iron_that_saturates_nothing_swings_between_the_distances():
    distances = np.array([0.4, 0.7, 1.0, 1.5, 2.2, 3.2, 4.5, 6.0]) * 1e-3
    values = np.array([1.0, 30.0, 40.0, 40.0, 40.0, 42.0, 48.0, 50.0])[:, None]  # bends where the bias does
    coordinate = DistanceCoordinate(float(np.ptp(distances)), kind="distance")
    knots, coefficients = _splines(coordinate, distances, values, np.full_like(values, np.nan))
    fine = np.linspace(distances[0], distances[-1], 501)
    along = (basis_matrix(coordinate.with_slopes(fine)[0], knots, 3) @ coefficients)[:, 0]
    assert np.diff(along).min() >= -1e-9
    at = (basis_matrix(coordinate.with_slopes(distances)[0], knots, 3) @ coefficients)[:, 0]
    assert at == pytest.approx(values[:, 0])


def test_without_the_flux_at_rest_the_patterns_of_small_currents_are_taken():
    table = made_up(hall=False)
    biased = replace(table, bias_A=np.ones((len(DISTANCES), 1)))
    np.testing.assert_array_equal(_entries(biased)[0], _entries(table)[0])


def test_inductances_that_are_not_positive_and_a_single_distance_make_no_model():
    table = made_up(patterns=2)
    broken = table.flux_linkage.copy()
    broken[3, 1:, 2:] *= -1.0
    with pytest.raises(FitError, match="Sweep more distances"):
        fit_eddy(replace(table, flux_linkage=broken), Plain(), 1e-9)
    with pytest.raises(FitError, match="at 1 mm alone"):
        fit_eddy(made_up().at(np.array([0])), Plain())


def with_conductivity(table, share):
    """The table of a first material that conducts better by a share, which takes its part of the resistance down."""
    n = 1 + len(table.circuits)
    turn = np.eye(n + table.patterns)
    resistance = np.eye(table.patterns) + (1.0 / (1.0 + share) - 1.0) * table.resistances[0]
    turn[n:, n:] = np.linalg.inv(np.linalg.cholesky(resistance)).T  # patterns of one ohm again
    return replace(table, flux_linkage=turn[1:, 1:].T @ table.flux_linkage @ turn)


def impedances(table, k):
    return 2j * np.pi * FREQUENCIES[:, None, None] * table.transfers(k, FREQUENCIES).flux_linkage


def test_a_larger_conductivity_changes_the_impedance_by_its_slope_and_its_bend():
    table, step = made_up(patterns=5), 1e-4
    more, as_drawn, less = (impedances(with_conductivity(table, np.expm1(x)), 2) for x in (step, 0.0, -step))
    changes = table.conductivity_changes(0, 2, FREQUENCIES)
    assert changes[0] == pytest.approx((more - less) / (2.0 * step), rel=1e-6)
    bend, error = (more - 2.0 * as_drawn + less) / step**2, 1e-15 * np.abs(as_drawn).max() / step**2
    assert changes[1] == pytest.approx(bend, rel=1e-5, abs=4.0 * error)


def test_conductivities_are_numbers_of_the_drawing():
    table = made_up(patterns=5)
    iron, copper = conductivities(table, fit_eddy(table, Plain(), 1e-9))
    assert (iron.key, copper.value) == ("materials.iron.conductivity_MS_per_m", 58.0)
    bare = made_up(circuits=0, hall=False)
    assert conductivities(bare, fit_eddy(bare, Plain(), 0.02)) == ()


@pytest.mark.parametrize("circuits", [1, 2])
def test_the_static_models_own_error_at_the_bias_stands_beside_that_of_the_patterns(within_a_hundredth, circuits):
    table = made_up(patterns=4, circuits=circuits)
    currents = np.full((len(DISTANCES), circuits), 0.7)
    names = ("coil", "other")[:circuits]
    table = replace(table, circuits=names, bias_A=currents, rest=0.2 * table.flux_linkage[:, :, 0])

    class Off(Plain):
        def state(self, distance, current):
            np.testing.assert_array_equal(distance, DISTANCES)
            np.testing.assert_array_equal(current, currents)
            inductance = table.flux_linkage[:, :circuits, 1 : 1 + circuits].copy()
            inductance[2] *= 1.2
            motional = 2.0 * table.force[:, 0, 1 : 1 + circuits]
            return MagneticState(np.zeros(len(DISTANCES)), 0.6 * motional, inductance)

    found = fit_eddy(table, Off(), 0.01, saturating=("iron", "other"))
    error = found.error
    assert found.bias.at(DISTANCES).tolist() == currents.tolist()
    assert found.bias.materials == ("iron",)  # the other does not conduct
    fields = table.flux_linkage[:, :circuits, 1 : 1 + circuits]
    assert error.static_force == pytest.approx(0.4)
    assert error.static_inductance == pytest.approx(0.2 * fields[2].max() / fields.max())
    assert within_a_hundredth.error.static_force is None
    assert within_a_hundredth.bias is None
