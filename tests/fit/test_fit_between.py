"""What a model may be off by between the points of its sweep, and whether its user is told to sweep more finely."""

import re
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.fit.build import fit_model
from femfit.fit.coenergy import fit_coenergy, halfway
from femfit.fit.coenergy_system import held_out_masks
from femfit.fit.constants import COARSE, COARSE_INDUCTANCE
from femfit.fit.rows import rms, rows_of_table
from femfit.tables.sweep_table import SweepTable
from support.bearing import grid
from support.closed_forms import FEW, HARD, NARROW, POT, SIX, VALVE, WIDE, fit_of, steel_fit
from support.command import worked
from support.one_current import flat
from support.reference import REFERENCE, needs_reference
from support.saturating_bearing import force, share
from support.sweeps import full_table

CONE = pd.read_csv(Path(__file__).with_name("conical_solenoid.csv"), comment="#")
MILLIMETRES = [0.4, 0.7, 1.0, 1.5, 2.2, 3.2, 4.5, 6.0]
COARSE_GRIDS = {
    "pot": (POT, SIX, WIDE),
    "valve": (VALVE, FEW, NARROW),
    "finer valve": (VALVE, np.linspace(0.0, 6.0, 13), NARROW),
    "hard pot": (HARD, np.linspace(0.0, 1.0, 5), 1e-3 * np.array([0.1, 0.4, 0.8, 1.5, 2.5, 4.0, 6.0])),
}


@cache
def fit_on(name):
    """The fit on one of the coarse grids, made once."""
    device, currents, distances = COARSE_GRIDS[name]
    return fit_model(device.table(currents, distances))


def missed(magnetics, device, rows):
    """Rms of what the model misses force, flux linkage and inductance by halfway, over the rms of the rows."""
    (d, i), magnetics = halfway(rows), flat(magnetics)
    columns = (("force", rows.force), ("flux_linkage", rows.linked[:, 0]), ("inductance", rows.inductance[:, 0, 0]))
    return [rms(getattr(magnetics, name)(d, i) - getattr(device, name)(d, i)) / rms(column) for name, column in columns]


@pytest.mark.parametrize("name", ["pot", "valve", "finer valve"])
def test_a_coarse_sweep_says_what_it_misses_within_a_factor_of_two_and_a_half(name):
    fit = fit_on(name)
    truth = missed(fit.model.magnetics, COARSE_GRIDS[name][0], fit.rows)
    assert fit.between.poor
    estimates = fit.between.force, fit.between.flux_linkage, fit.between.inductance
    for estimate, exact in zip(estimates, truth, strict=True):
        assert 0.4 < estimate / exact < 2.5  # at worst 0.44, of the valve's flux linkage
    facts = fit.to_dict()["between_points"]
    assert facts["inductance"] == fit.between.inductance
    assert set(facts["finer"]) == {"distance_m", "current_A"}
    assert str(fit).count("between its points it may miss force") == 1


@pytest.mark.parametrize("count", [5, 9])
def test_a_conical_solenoid_says_what_it_misses_within_a_factor_of_two(count):
    part, whole = (
        SweepTable(
            rows.drop(columns="distance_mm").assign(distance_m=1e-3 * rows["distance_mm"], status="ok").reset_index(),
            full_table().manifest,
        )
        for rows in (
            CONE[CONE["distance_mm"].isin(MILLIMETRES) & CONE["current_A"].isin(np.linspace(0.0, 2.0, count))], CONE,
        )
    )  # fmt: skip
    fit, truth = fit_model(part), rows_of_table(whole)
    new = ~(np.isin(truth.distance, fit.rows.distances) & np.isin(truth.current, fit.rows.currents))
    points, magnetics = (truth.distance[new], truth.current[new]), flat(fit.model.magnetics)
    for estimate, name in ((fit.between.force, "force"), (fit.between.inductance, "inductance")):
        column = getattr(truth, name).ravel()
        assert 0.5 < estimate / (rms(getattr(magnetics, name)(*points) - column[new]) / rms(column)) < 2.0
    assert sum("Add to [sweep] the distances" in note for note in fit.notes) == 1


@pytest.mark.parametrize("name", ["pot", "valve"])
def test_what_it_says_to_add_nearly_halves_the_errors(name):
    (device, currents, distances), fit = COARSE_GRIDS[name], fit_on(name)
    rows, finer = fit.rows, fit.between.finer
    more = device.table(np.union1d(currents, finer["current_A"]), np.union1d(distances, finer["distance_m"]))
    before, after = (missed(one.magnetics, device, rows) for one in (fit.coenergy, fit_coenergy(rows_of_table(more))))
    assert after[0] < 0.55 * before[0]
    assert after[2] < 0.55 * before[2]


@pytest.mark.parametrize("name", ["hard pot", "valve"])
def test_points_that_a_coarse_sweep_is_told_to_add_make_the_force_better(name):
    (device, currents, distances), coarse = COARSE_GRIDS[name], fit_on(name)
    (note,) = (note for note in coarse.notes if "too coarse" in note)
    assert "left out" in note  # the printed misfit to all points is another number
    finer = coarse.to_dict()["finer_sweep"]
    finer = fit_model(
        device.table(np.union1d(currents, finer["current_A"]), np.union1d(distances, finer["distance_m"]))
    )
    assert finer.misfit.force_share < 0.5 * coarse.misfit.force_share
    d, i = (x.ravel() for x in np.meshgrid(np.linspace(*distances[[0, -1]], 31), np.linspace(0.1, 1.0, 37)))
    i = i * currents[-1]
    off = [rms(flat(fit.model.magnetics).force(d, i) - device.force(d, i)) for fit in (coarse, finer)]
    assert off[1] < 0.75 * off[0]
    assert not any("too coarse" in note for note in finer.notes)


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["pot from eleven", "hard pot from eleven"])
def test_a_good_sweep_is_not_told_to_be_finer(name):
    device = {"pot from eleven": POT, "hard pot from eleven": HARD}[name]
    finer = np.geomspace(1e-4, 6e-3, 13)
    fit = fit_of(name) if device is POT else fit_model(HARD.table(np.linspace(0.0, 1.0, 11), finer))
    exact = missed(fit.model.magnetics, device, fit.rows)
    assert exact[0] < fit.between.force < COARSE
    assert exact[2] < fit.between.inductance < COARSE_INDUCTANCE
    assert not any("[sweep]" in note for note in fit.notes)


def test_straight_iron_and_tables_without_inductances_have_no_estimate():
    assert fit_of("rig").between is None
    assert fit_of("plunger from nine distances").between is None


def test_a_coenergy_that_the_sweep_does_not_determine_says_so():
    # Beyond a knee the force grows no further: six currents cannot tell where the knee stands
    def knee(d, i):
        return 2e-3 / d * np.minimum(i / 0.5, 2e-2 / d) ** 2

    table = full_table(currents=np.linspace(0.0, 3.0, 6))
    d, i = table.rows["distance_m"], table.rows["current_A"]
    rows = table.rows.assign(force_N=knee(d, i)).drop(columns=["flux_linkage_Wb", "hall_T"])
    fit = fit_model(SweepTable(rows, table.manifest), inductance_H=0.01)
    assert fit.model.misfit.force_rms_relative > 0.01
    assert any("too coarse" in note for note in fit.notes)


@pytest.mark.parametrize(("table", "times"), [(full_table(), None), (POT.table(SIX, WIDE), 1)])
def test_rows_left_out_keep_the_ends_of_both_axes_and_scattered_ones_come_once(table, times):
    rows = rows_of_table(table)
    masks = held_out_masks(rows)
    for mask in masks:
        fitted = rows.take(~mask)
        assert fitted.distances[[0, -1]].tolist() == rows.distances[[0, -1]].tolist()
        assert fitted.currents[[0, -1]].tolist() == rows.currents[[0, -1]].tolist()
    edge = np.isin(rows.distance, rows.distances[[0, -1]]) | np.isin(rows.current, rows.currents[[0, -1]])
    if times:
        np.testing.assert_array_equal(np.sum(masks, axis=0), np.where(edge, 0, times))


def test_what_whole_distances_left_out_miss_is_printed_and_both_halves_of_a_mirror_are_refined():
    """Five distances leave the force between them open."""
    currents, distances = (0.0, 1.0, 2.0, 3.0), np.linspace(0.12e-3, 0.88e-3, 5)
    fit = steel_fit(currents, currents, tuple(distances))
    of_distances, _ = map(float, re.findall(r"([\d.]+) % at most", str(fit).splitlines()[-1]))
    d, i = grid(np.linspace(0.12e-3, 0.88e-3, 33), currents, currents)
    between = 100.0 * share(fit.model.force(d, i), force(d, i)).max()
    assert between < 4.0 * of_distances
    (note,) = (note for note in fit.notes if "too coarse" in note)
    assert "whole distance left out" in note
    axis, added = fit.circuits.finer
    assert axis == "distance"
    assert len(added) > 1
    np.testing.assert_allclose(np.sort(added), np.sort(1e-3 - np.array(added)), atol=1e-12)


@pytest.mark.nightly
@needs_reference
def test_a_swept_bearing_of_steel_1010_is_met_at_every_point(tmp_path):
    worked("sweep", REFERENCE / "strangers" / "amb2.toml", "-o", tmp_path / "sweep")
    fit = ff.fit_model(tmp_path / "sweep")
    missed = share(fit.model.force(fit.rows.distance, fit.rows.circuit_currents), fit.rows.force)
    assert missed.max() < 0.03
    assert np.sqrt(np.mean(missed**2)) < 0.01
    d, i = fit.rows.distance, fit.rows.circuit_currents
    assert share(-fit.model.force(1e-3 - d, i[:, ::-1]), fit.model.force(d, i)).max() < 2e-3
