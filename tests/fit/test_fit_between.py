"""What a co-energy may be off by between the points of its sweep, beside points that the sweep does not have."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from femfit.fit.build import fit_model
from femfit.fit.coenergy import fit_coenergy, halfway
from femfit.fit.constants import COARSE, COARSE_INDUCTANCE
from femfit.fit.rows import rms, rows_of_table
from femfit.tables.sweep_table import SweepTable
from support.saturating_circuit import SaturatingCircuit
from support.sweeps import full_table

CONE = pd.read_csv(Path(__file__).with_name("conical_solenoid.csv"), comment="#")
MILLIMETRES = [0.4, 0.7, 1.0, 1.5, 2.2, 3.2, 4.5, 6.0]

POT = SaturatingCircuit()
VALVE = SaturatingCircuit(turns=300.0, area=5.5e-5, fringing=1e-3, saturation=7.5e-5, core=5.0, leakage=0.8e-3)
WIDE = 1e-3 * np.array([0.2, 0.3, 0.4, 0.55, 0.75, 1.0, 1.4, 1.9, 2.6, 3.5, 4.6, 6.0])
NARROW = 1e-3 * np.array([0.05, 0.08, 0.12, 0.18, 0.25, 0.35])
COARSE_GRIDS = [
    (POT, np.linspace(0.0, 1.0, 6), WIDE),
    (VALVE, np.array([0.0, 0.5, 1.0, 2.0, 3.5, 6.0]), NARROW),
    (VALVE, np.linspace(0.0, 6.0, 13), NARROW),
]


def rows_of(table):
    return rows_of_table(table, None, 9.80665)


def missed(magnetics, device, rows):
    """Rms of what the model misses force, flux linkage and inductance by halfway, over the rms of the rows."""
    d, i = halfway(rows)
    columns = (("force", rows.force), ("flux_linkage", rows.linked[:, 0]), ("inductance", rows.inductance[:, 0, 0]))
    return [rms(getattr(magnetics, name)(d, i) - getattr(device, name)(d, i)) / rms(column) for name, column in columns]


def cone(millimetres, amperes):
    """A part of the conical solenoid's sweep as a table, and all of it."""
    tables = []
    for part in (CONE[CONE["distance_mm"].isin(millimetres) & CONE["current_A"].isin(amperes)], CONE):
        table = full_table()
        rows = part.drop(columns="distance_mm").assign(
            distance_m=1e-3 * part["distance_mm"], force_error_N=0.0, status="ok"
        )
        tables.append(SweepTable(rows.reset_index(drop=True), table.manifest))
    return tables


@pytest.mark.parametrize(("device", "currents", "distances"), COARSE_GRIDS, ids=["pot", "valve", "valve, finer"])
def test_a_coarse_sweep_says_what_it_misses_within_a_factor_of_two_and_a_half(
    fit_of_circuit, device, currents, distances
):
    fit = fit_of_circuit(device, currents, distances)
    found, truth = fit.between, missed(fit.model.magnetics, device, fit.rows)
    assert found.poor
    for estimate, exact in zip((found.force, found.flux_linkage, found.inductance), truth, strict=True):
        assert 0.4 < estimate / exact < 2.5  # at worst 0.44, of the valve's flux linkage


@pytest.mark.parametrize("amperes", [np.linspace(0.0, 2.0, 5), np.linspace(0.0, 2.0, 9)], ids=["5", "9"])
def test_a_conical_solenoid_says_what_it_misses_within_a_factor_of_two(amperes):
    part, whole = cone(MILLIMETRES, amperes)
    fit, truth = fit_model(part), rows_of(whole)
    new = ~(np.isin(truth.distance, fit.rows.distances) & np.isin(truth.current, fit.rows.currents))
    at, magnetics = (truth.distance[new], truth.current[new]), fit.model.magnetics
    for estimate, name in ((fit.between.force, "force"), (fit.between.inductance, "inductance")):
        column = getattr(truth, name).ravel()
        assert 0.5 < estimate / (rms(getattr(magnetics, name)(*at) - column[new]) / rms(column)) < 2.0
    largest = np.abs(magnetics.inductance(*at) - truth.inductance[new, 0, 0]).max() / rms(truth.inductance)
    assert largest > 0.25
    assert 0.5 < fit.between.largest / largest < 2.0
    assert sum("Add to [sweep] the distances" in note for note in fit.notes) == 1
    assert str(fit).count("between its points it may miss force") == 1


@pytest.mark.parametrize(("device", "currents", "distances"), COARSE_GRIDS[:2], ids=["pot", "valve"])
def test_what_it_says_to_add_nearly_halves_the_errors(fit_of_circuit, device, currents, distances):
    fit = fit_of_circuit(device, currents, distances)
    rows, finer = fit.rows, fit.between.finer
    more = device.table(np.union1d(currents, finer["current_A"]), np.union1d(distances, finer["distance_m"]))
    before, after = (missed(one.magnetics, device, rows) for one in (fit.coenergy, fit_coenergy(rows_of(more))))
    assert after[0] < 0.55 * before[0]
    assert after[2] < 0.55 * before[2]


@pytest.mark.parametrize(
    ("core", "saturation", "currents", "distances"),
    [
        (120.0, 8.3e-4, 11, WIDE),
        (400.0, 5e-4, 11, np.geomspace(1e-4, 6e-3, 13)),
    ],
)
def test_a_good_sweep_is_not_told_to_be_finer(fit_of_circuit, core, saturation, currents, distances):
    device = SaturatingCircuit(core=core, saturation=saturation)
    fit = fit_of_circuit(device, np.linspace(0.0, 1.0, currents), distances)
    exact = missed(fit.model.magnetics, device, fit.rows)
    assert exact[0] < fit.between.force < COARSE
    assert exact[2] < fit.between.inductance < COARSE_INDUCTANCE
    assert not any("[sweep]" in note for note in fit.notes)


def test_the_result_holds_the_estimate_as_data(fit_of_circuit):
    fit = fit_of_circuit(*COARSE_GRIDS[0])
    data = fit.to_dict()["between_points"]
    assert data["inductance"] == fit.between.inductance
    assert set(data["finer"]) == {"distance_m", "current_A"}


def test_straight_iron_and_tables_without_inductances_have_no_estimate(closed_form_fit, fit_of_circuit):
    assert closed_form_fit.between is None
    assert fit_of_circuit(*COARSE_GRIDS[0], "inductance_H").between is None
