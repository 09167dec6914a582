"""Where a sweep is too coarse for its model, its user is told what to add, and that helps; a sharp knee."""

import re
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import fixed_quad

import femfit as ff
from femfit.fit.build import fit_model
from femfit.fit.coenergy_system import held_out_masks
from femfit.fit.rows import rms, rows_of_table
from support.bearing import grid
from support.closed_forms import FEW, HARD, NARROW, POT, SIX, VALVE, WIDE, steel_fit
from support.one_current import flat
from support.saturating_bearing import force, share
from support.sweeps import full_table

COARSE_GRIDS = {
    "valve": (VALVE, FEW, NARROW),
    "hard pot": (HARD, np.linspace(0.0, 1.0, 5), 1e-3 * np.array([0.1, 0.4, 0.8, 1.5, 2.5, 4.0, 6.0])),
}


@pytest.mark.parametrize("name", ["hard pot", "valve"])
def test_points_that_a_coarse_sweep_is_told_to_add_twice_make_the_model_better_between_its_points(name):
    device, currents, distances = COARSE_GRIDS[name]
    places = np.meshgrid(np.linspace(*distances[[0, -1]], 31), np.linspace(0.1, 1.0, 37) * currents[-1])
    d, i = (axis.ravel() for axis in places)
    missed = []
    for _ in range(3):
        fit = fit_model(device.table(currents, distances))
        assert sum("too coarse: between its points" in note for note in fit.notes) == 1
        model, finer = flat(fit.model.magnetics), fit.to_dict()["finer_sweep"]
        quantities = "force", "inductance"
        missed.append([rms(getattr(model, name)(d, i) - getattr(device, name)(d, i)) for name in quantities])
        currents, distances = np.union1d(currents, finer["current_A"]), np.union1d(distances, finer["distance_m"])
    assert missed[2][0] < 0.25 * missed[0][0]
    assert missed[2][1] < 0.6 * missed[0][1]


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


@pytest.mark.parametrize(
    ("device", "currents", "distances"), [*COARSE_GRIDS.values(), (POT, SIX, WIDE)], ids=["valve", "hard pot", "pot"]
)
def test_what_is_missed_between_the_points_is_said_to_a_factor_of_three(device, currents, distances):
    """In rms; its own points the fit of the hard pot meets ten times better."""
    fit = fit_model(device.table(currents, distances))
    between = fit.misfit.between
    shares = {"force": between.force_share, "inductance": between.inductance_share}
    axes = [np.concatenate([np.linspace(*ends, 9) for ends in pairwise(axis)]) for axis in (distances, currents)]
    d, i = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    for quantity in ("force", "inductance"):
        truth = getattr(device, quantity)(d, i)
        missed = rms(getattr(flat(fit.model.magnetics), quantity)(d, i) - truth) / rms(truth)
        assert missed / 3.0 < shares[quantity] < 3.0 * missed


DISTANCES_M, CURRENTS_A = np.array([0.15, 0.225, 0.3, 0.6, 1.0, 1.5, 2.0]) * 1e-3, [0.0, 0.25, 0.5, 0.75, 1.0, 1.5]


def knee(distance, current, saturated_Wb, sharpness, reluctance_m):
    """Flux linkage x / (1 + (x / s)^n)^(1/n) + L_0 i with x = c i / (d + 0.1 mm): n says how sharp the knee is."""
    x = reluctance_m / (distance + 1e-4) * current
    return x / (1.0 + (x / saturated_Wb) ** sharpness) ** (1.0 / sharpness) + 2e-3 * current


@pytest.mark.parametrize(
    ("saturated_Wb", "sharpness", "reluctance_m"), [(0.02, 12, 5e-5), (0.02, 30, 2e-5), (0.04, 6, 5e-5)]
)
def test_an_inductance_is_positive_between_currents_about_a_sharp_knee(tmp_path, saturated_Wb, sharpness, reluctance_m):
    device = saturated_Wb, sharpness, reluctance_m
    d, i = (x.ravel() for x in np.meshgrid(DISTANCES_M, CURRENTS_A, indexing="ij"))

    def coenergy(distance):
        return fixed_quad(lambda s: knee(distance[:, None], np.outer(i, s), *device), 0.0, 1.0, n=400)[0] * i

    least = np.maximum(i - 1e-6, 0.0)
    rise = knee(d, i + 1e-6, *device) - knee(d, least, *device)
    columns = {"current_A": i, "distance_m": d, "force_N": (coenergy(d - 1e-8) - coenergy(d + 1e-8)) / 2e-8}
    columns |= {"flux_linkage_Wb": knee(d, i, *device), "inductance_H": rise / (i + 1e-6 - least)}
    pd.DataFrame(columns).to_csv(tmp_path / "knee.csv", index=False)
    # So coarse a grid does not show to which co-energy a knee's force and flux linkage belong
    model = ff.fit_model(ff.import_table(tmp_path / "knee.csv", accept=("reciprocity",))).model
    assert model.magnetics.inductance(*model.validity.grid(101, 101)).min() > 0.0
