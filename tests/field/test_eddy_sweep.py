"""The harmonic part of a sweep: patterns of induced currents held against direct solutions, files, resumption."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import femfit.field.eddy_sweep as eddy_sweep_module
from femfit.core.errors import TableError
from femfit.device.load import actuator_from_toml
from femfit.field.eddy_probe import EddyProbe
from femfit.field.layout import layout_of
from femfit.field.moving_mesh import MovingMesh
from femfit.field.sweep import run_sweep
from femfit.field.tolerance import SolverSettings
from femfit.tables.eddy_table import NAME, read_eddy, write_eddy
from femfit.tables.impedance_table import NAME as IMPEDANCE
from femfit.tables.sweep_table import read_sweep_table
from support.eddy_pot import POT


@pytest.fixture(scope="module")
def actuator():
    return actuator_from_toml(POT)


@pytest.fixture(scope="module")
def swept(actuator, tmp_path_factory):
    directory = tmp_path_factory.mktemp("eddy-pot")
    return directory, run_sweep(actuator, directory, workers=2)


def test_patterns_give_the_direct_solution_on_another_mesh_and_at_other_frequencies(actuator, swept):
    _, table = swept
    settings = SolverSettings(order=eddy_sweep_module.ORDER, skin_frequency_Hz=1000.0)
    layout = layout_of(actuator, settings)
    distance = actuator.sweep.distances_m[1]
    moving = MovingMesh(actuator, (distance,), layout, settings)
    exact, _ = EddyProbe(actuator, moving, distance, settings.order).transfers(np.array([20.0, 200.0, 900.0]))
    departures = table.eddy.transfers(1, exact.frequencies_Hz).departures(exact)
    assert departures.max() < 0.004  # an own mesh, frequencies between those of the patterns
    assert np.abs(exact.flux_linkage[-1, 0, 0]) < 0.7 * np.abs(exact.flux_linkage[0, 0, 0])  # there is an effect


def test_estimated_errors_are_small_and_those_of_motion_too(swept):
    eddy = swept[1].eddy
    assert 0.0 < eddy.errors[:, 0].max() < 0.01
    assert eddy.braking_error < 0.5 * eddy.asked_error


def test_forms_are_symmetric_and_positive(swept):
    eddy = swept[1].eddy
    among = eddy.flux_linkage[:, :, 1:]
    assert np.abs(among - among.swapaxes(1, 2)).max() < 1e-12 * np.abs(among).max()
    assert np.linalg.eigvalsh(among).min() > 0.0
    at_rest = swept[1].rows.query("current_A == 0.0")["inductance_H"].to_numpy()
    assert among[:, 0, 0] == pytest.approx(at_rest, rel=1e-3)  # of another mesh


def test_impedance_file_has_every_distance_bias_and_frequency(swept, actuator):
    directory, table = swept
    rows = pd.read_csv(directory / IMPEDANCE)
    assert len(rows) == 4 * 3 * len(actuator.frequencies_Hz)
    assert set(rows) >= {"resistance_ohm", "inductance_H", "force_real_N_per_A", "hall_imag_T_per_A", "force_error"}
    near = rows[(rows["distance_m"] == 0.001) & (rows["current_A"] == 1.0)]
    assert np.all(np.diff(near["resistance_ohm"]) > 0.0)
    assert np.all(np.diff(near["inductance_H"]) < 0.0)
    slope = table.rows.set_index(["distance_m", "current_A"])["force_N"][0.001]
    at_rest = slope[1.0] - slope[-1.0]  # of a parabola: twice its linear term
    mean = rows[(rows["distance_m"] == 0.001) & (rows["current_A"] == 0.0)]["force_real_N_per_A"].iloc[0]
    assert mean == pytest.approx(0.5 * at_rest, rel=0.02)  # 10 Hz


def test_a_finished_sweep_solves_nothing_again(swept, actuator, monkeypatch):
    directory, table = swept
    monkeypatch.setattr("femfit.field.eddy_task.ProbeTask.result", None)
    monkeypatch.setattr("femfit.field.eddy_task.FormsTask.result", None)
    again = run_sweep(actuator, directory, workers=1)
    assert np.array_equal(again.eddy.force, table.eddy.force)
    assert np.array_equal(read_sweep_table(directory).eddy.flux_linkage, table.eddy.flux_linkage)


def test_distances_without_eddy_currents_are_named(swept):
    table = swept[1]
    assert table.still_mm == ()
    left = replace(table.eddy, distances_m=table.eddy.distances_m[[0, 2]])
    assert replace(table, eddy=left).still_mm == (1.5, 2.5)


def test_a_damaged_file_says_so(tmp_path, swept):
    whole = (swept[0] / NAME).read_bytes()
    for content in (b"PK\x03\x04 not whole", b"", b"text", whole[: len(whole) // 2]):
        (tmp_path / NAME).write_bytes(content)
        with pytest.raises(TableError, match="Sweep again"):
            read_eddy(tmp_path)
    places = range(100, len(whole), len(whole) // 40)
    for content in (whole[:at] + 8 * b"\xff" + whole[at + 8 :] for at in places):
        (tmp_path / NAME).write_bytes(content)
        with suppress(TableError):  # a spoilt date or the like is no damage
            read_eddy(tmp_path)


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("force", lambda one: np.nan * one, "no number"),
        ("force", lambda one: one[:, 1:], "another shape"),
        ("errors", lambda one: one[:-1], "another shape"),
        ("flux_linkage", lambda one: 1j * one, "another shape"),
        ("distances_m", lambda one: one[:0], "another shape"),
    ],
)
def test_arrays_that_do_not_belong_together_are_refused(tmp_path, swept, name, change, words):
    table = replace(swept[1].eddy, **{name: change(getattr(swept[1].eddy, name))})
    write_eddy(table, tmp_path)
    with pytest.raises(TableError, match=words):
        read_eddy(tmp_path)


def test_without_frequencies_nothing_is_written(actuator, tmp_path):
    (tmp_path / NAME).write_bytes(b"of an earlier drawing")
    plain = replace(actuator, frequencies_Hz=(), sweep=replace(actuator.sweep, distances_m=(1e-3,)))
    assert run_sweep(plain, tmp_path, workers=1).eddy is None
    assert not (tmp_path / NAME).exists()
