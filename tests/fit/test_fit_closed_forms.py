"""Every kind of device against its closed form, and what holds for every model; a steel bearing by the commands."""

import json

import numpy as np
import pytest

import femfit as ff
from femfit.fit.build import fit_model
from femfit.fit.coenergy import fit_coenergy, obeyed_shapes
from femfit.fit.rows import rms, rows_of_table
from femfit.laws.catalogue import BUILT_IN
from femfit.model.several_magnetics import CoenergyTensor
from support.bearing import grid
from support.closed_forms import (
    DEVICES,
    HARD,
    NARROW,
    POT,
    RIG_POINTS,
    SIX,
    VALVE,
    VOICE_POINTS,
    WIDE,
    VoiceCoil,
    fit_of,
    pair_table,
    ring_force,
    steel_fit,
)  # fmt: skip
from support.command import femfit, worked
from support.one_current import flat
from support.saturating_bearing import DISTANCES, GAP, force, inductance, share, write_sweep
from support.sweeps import MASS, ClosedForm, force_table, full_table

G = 9.80665
ONE_SIDE, BOTH_SIDES = (0.0, 1.0, 2.0, 3.0), (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)

LONG = "pot from eleven"
"""Of six currents the same is fitted."""


every_device = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.nightly] * (name == LONG)) for name in DEVICES]
)


def rows_of(table):
    return rows_of_table(table, MASS, G)


@every_device
def test_what_lies_between_the_points_is_met(name):
    device, magnetics = DEVICES[name], flat(fit_of(name).model.magnetics)
    for quantity, most in device.most.items():
        truth = getattr(device.truth, quantity)(*device.between)
        assert rms(getattr(magnetics, quantity)(*device.between) - truth) < most * rms(truth), quantity


def test_a_linear_winding_needs_one_parabola_in_the_current_and_shapes_that_its_rows_obey():
    fit = fit_of("rig").coenergy
    assert (fit.basis.functions.degrees, fit.basis.functions.cells) == ((2,), (1,))
    assert fit.basis.size <= 40
    assert (fit.constraints, fit.active) == (("inductance", "decreasing", "attracting"), ())
    assert abs(flat(fit.magnetics).coenergy(np.array(0.045), np.array(0.0))) < 1e-18
    assert fit_of("rig").misfit.force_rms_relative < 1e-3
    assert fit_of("winding that saturates").coenergy.basis.functions.degrees[0] > 2


@pytest.mark.parametrize(
    ("table", "shapes"),
    [
        (full_table(ClosedForm(b=-1e-6, L_1=0.0)), ["inductance", "decreasing"]),
        (force_table(lambda d, i: 1.0 + d - 0.1 * i), []),
        (pair_table(), []),
    ],
)
def test_a_shape_that_the_rows_break_is_not_imposed(table, shapes):
    assert obeyed_shapes(rows_of(table)) == shapes


def test_flux_linkage_makes_the_motional_constant_better_than_force_alone_under_noise():
    table, rng = full_table(), np.random.default_rng(4)
    table.rows["force_error_N"] = 2e-3 * table.rows["force_N"]
    table.rows["force_N"] += table.rows["force_error_N"] * rng.standard_normal(len(table.rows))
    table.rows["flux_linkage_Wb"] += 2e-7 * rng.standard_normal(len(table.rows))
    truth = ClosedForm().motional_constant(*RIG_POINTS)
    missed = [
        rms(flat(fit_coenergy(rows_of(one)).magnetics).motional_constant(*RIG_POINTS) / truth - 1.0)
        for one in (table, type(table)(table.rows.drop(columns="flux_linkage_Wb"), table.manifest))
    ]
    assert missed[0] < 0.5 * missed[1]


def test_a_force_alone_takes_the_declared_inductance_at_the_largest_distance():
    magnetics, (d, i) = fit_of("force alone").model.magnetics, RIG_POINTS
    end = np.array(0.045)
    assert flat(magnetics).inductance(end, np.array(0.7)) == pytest.approx(16e-3, rel=1e-9)
    # What the force tells is the change of inductance with distance: L_1 (exp(-d/h) - exp(-d_max/h))
    change = ClosedForm().inductance(d, i) - ClosedForm().inductance(end, np.array(0.7))
    np.testing.assert_allclose(flat(magnetics).inductance(d, i) - 16e-3, change, atol=3e-5)


def test_a_force_that_passes_zero_counts_a_hundredth_of_the_lobes_beside_it():
    rows = fit_of("force through zero").rows
    middle = np.isclose(rows.distance, 0.016)
    np.testing.assert_allclose(rows.force_scale[middle], 0.01 * np.max(np.abs(rows.force)))


def test_the_law_of_a_moving_coil_gives_its_force_factor_and_inductance():
    fit, (d, i) = fit_model(DEVICES["voice coil"].table, law="all"), VOICE_POINTS
    fitted = {candidate.law.name for candidate in fit.ranking.candidates if candidate.fit}
    assert fitted == {law.name for law in BUILT_IN if law.passes_face}
    assert fit.law.law.passes_face
    coil = fit_model(DEVICES["voice coil"].table, law="moving-coil")
    # A law for microcontrollers may miss 2 % of the rms force; the poles of this bell lie within the stroke
    truth = VoiceCoil().force(d, i)
    assert rms(coil.model.force(d, i) - truth) < 0.02 * rms(truth)
    assert coil.misfit.inductance_share < 0.01
    pair, d = fit_model(pair_table(10), law="moving-coil").model, np.linspace(-0.015, 0.03, 101)
    assert rms(pair.force(d, 0.0) - ring_force(d)) < 0.15 * rms(ring_force(d))  # seven numbers, three turns
    assert pair.circuit is None


@pytest.mark.nightly
def test_each_point_of_a_steel_bearing_and_what_lies_between_is_met_relative_to_its_own_force():
    """Fitted from 0 A up, without a magnet: the same with all currents reversed, and from the other side."""
    model, between = steel_fit(ONE_SIDE, ONE_SIDE).model, np.linspace(0.0, 2.9, 6)
    assert isinstance(model.magnetics, CoenergyTensor)
    d, i = grid(np.linspace(0.21e-3, 0.79e-3, 9), between, between)
    missed = share(model.force(d, i), force(d, i))
    assert missed.max() < 0.05
    assert rms(missed) < 0.01
    rows = steel_fit(ONE_SIDE, ONE_SIDE).rows
    assert share(model.force(rows.distance, rows.circuit_currents), rows.force).max() < 0.03
    largest = force(0.2e-3, np.array([3.0, 0.0]))
    np.testing.assert_allclose(model.force(d, -i), model.force(d, i), atol=1e-12 * largest)
    np.testing.assert_allclose(model.flux_linkage(d, -i), -model.flux_linkage(d, i), atol=1e-12)
    np.testing.assert_allclose(model.force(d, 0.0 * i), 0.0, atol=1e-12 * largest)
    assert share(-model.force(GAP - d, i[:, ::-1]), model.force(d, i)).max() < 2e-3
    assert np.linalg.eigvalsh(model.inductance(d, i)).min() > 0.0
    own, truth = (np.diagonal(x, axis1=1, axis2=2) for x in (model.inductance(d, i), inductance(d, i)))
    assert np.abs(own - truth).max() < 0.05 * truth.max()
    d, i = grid(np.linspace(0.25e-3, 0.75e-3, 5), np.linspace(-2.9, 2.9, 7), np.linspace(-2.9, 2.9, 7))
    missed = share(steel_fit(ONE_SIDE, BOTH_SIDES).model.force(d, i), force(d, i))
    assert missed.max() < 0.1  # where both magnets nearly cancel, between steps of 1 A over a knee
    assert rms(missed) < 0.02


@pytest.mark.parametrize(("device", "currents", "distances", "cells"), [
    (VALVE, np.linspace(0.0, 6.0, 13), 1e-3 * np.linspace(0.05, 0.35, 7), 36),
    (VALVE, np.linspace(0.0, 6.0, 25), NARROW, 24),  # too many for three cells each
])  # fmt: skip
def test_currents_have_three_cells_from_each_to_the_next_while_these_are_few(device, currents, distances, cells):
    fit = fit_coenergy(rows_of(device.table(currents, distances)))
    assert fit.basis.functions.cells == (cells,)
    rows = rows_of(device.table(np.linspace(0.1, 6.0, 60), np.linspace(distances[0], distances[-1], 31)))
    # With 24 cells, two from one current to the next, the points of thirteen currents were missed by 0.4 %
    assert rms(flat(fit.magnetics).force(rows.distance, rows.current) - rows.force) < 0.005 * rms(rows.force)


def test_a_bend_between_six_currents_is_met_with_inductances_with_holes_in_them_and_without_any():
    """Without inductances the splines had six cells of equal length, which missed the force by 6 %."""
    table, device = DEVICES["pot from six currents"].table, DEVICES["pot from six currents"]
    d, i = device.between
    holes = np.random.default_rng(3).choice(len(table.rows), 8, replace=False)
    with_holes = table.rows.assign(inductance_H=table.rows["inductance_H"].where(~table.rows.index.isin(holes)))
    missed = [
        rms((flat(model.magnetics).force(d, i) - POT.force(d, i)) / POT.force(d, i))
        for model in (
            fit_of("pot from six currents").model,
            fit_model(type(table)(with_holes, table.manifest)).model,
            fit_model(type(table)(table.rows.drop(columns="inductance_H"), table.manifest)).model,
        )
    ]
    assert max(missed) < 0.02


@pytest.mark.parametrize("inductance_H", [
    lambda d, i, flux: np.where(i > 0, flux / np.where(i > 0, i, 1.0), np.nan),  # the quotient, not the slope
    lambda d, i, flux: 16e-3 + 2e-3 * np.exp(-d / 0.012) + 0.0 * i,  # the same at every current
])  # fmt: skip
def test_inductances_that_say_nothing_of_a_bend_add_no_equations(inductance_H):
    table = POT.table(SIX, WIDE)
    d, i, flux = (table.rows[name].to_numpy() for name in ("distance_m", "current_A", "flux_linkage_Wb"))
    assert rows_of(type(table)(table.rows.assign(inductance_H=inductance_H(d, i, flux)), {})).inductance is None


def test_a_basis_is_judged_at_the_outermost_points_as_well():
    # Judged on inner points alone, the basis missed the corner by 40 % of the rms force
    coarse = HARD.table(np.linspace(0.0, 1.0, 5), 1e-3 * np.array([0.1, 0.4, 0.8, 1.5, 2.5, 4.0, 6.0]))
    rows = rows_of(coarse)
    fit = fit_coenergy(rows)
    assert rms(flat(fit.magnetics).force(rows.distance, rows.current) - rows.force) < 0.04 * rms(rows.force)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Swept from 0 A up, and fitted by the command."""
    folder = write_sweep(tmp_path_factory.mktemp("bearing") / "sweep", *2 * [np.array(ONE_SIDE)])
    worked("fit", folder, "-o", folder / "model.json", "--json", folder / "fit.json")
    return folder


def test_voltages_move_it_and_reversed_together_as_they_do_forwards(folder):
    model = ff.read_model(folder / "model.json")
    moved = ff.simulate(model, voltage_V={"bottom": 1.2, "top": 0.4}, start_m=0.5e-3, duration_s=4e-3)
    assert not moved.extrapolated
    assert moved.table["distance_m"][-1] < 0.5e-3
    forwards, backwards = (
        ff.simulate(model, voltage_V={"bottom": sign * 5.0, "top": sign * 4.0}, start_m=0.5e-3, duration_s=1.2e-3)
        for sign in (1.0, -1.0)
    )
    assert backwards.table["time_s"][-1] == pytest.approx(1.2e-3)
    np.testing.assert_allclose(backwards.table["distance_m"][-1], forwards.table["distance_m"][-1], rtol=1e-9)


def test_an_audit_finds_a_quadratic_form_with_terms_of_magnets_wrong(folder):
    """As models of such devices were fitted before: a quadratic form with linear terms, valid for either sign."""
    right = json.loads((folder / "model.json").read_text())
    wrong, d = right | {"name": "as-before"}, DISTANCES
    knots = [0.2, 0.2, 0.2, 0.8, 0.8, 0.8]
    inverse = {"coordinate": "distance", "reference_distance_m": 1e-3, "u_knots": knots, "u_degree": 2}
    own = inductance(d[[0, 3, 6]], np.zeros((3, 2)))
    entries = [[0.002 * k, 3e-4 * k, -2e-4 * k, own[k, 0, 0], own[k, 0, 1], own[k, 1, 1]] for k in range(3)]
    wrong["magnetics"] = {
        "kind": "coenergy_matrix", "circuits": ["bottom", "top"], **inverse, "coefficients": entries,
    }  # fmt: skip
    wrong["validity"] = {key: value for key, value in right["validity"].items() if key != "mirrored"} | {
        "current_min_A": -3.0, "further_A": [[-3.0, 3.0]],
    }  # fmt: skip
    (folder / "before.json").write_text(json.dumps(wrong))
    told = femfit("audit", folder / "before.json", "--json", folder / "before-audit.json")
    assert told.returncode == 1
    found = json.loads((folder / "before-audit.json").read_text())["findings"]
    assert "point_misfit" in {one["code"] for one in found if one["severity"] == "wrong"}
    worked("audit", folder / "model.json", "--json", folder / "audit.json")
    found = {one["code"]: one for one in json.loads((folder / "audit.json").read_text())["findings"]}
    assert found["point_misfit"]["severity"] == "holds"
