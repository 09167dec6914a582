"""The harmonic part of a sweep: patterns held against direct solutions, files, resumption, slopes of impedances."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit import fit_model, run_sweep
from femfit.core.errors import TableError
from femfit.device.drawn_numbers import numbers_from_toml
from femfit.device.load import actuator_from_toml
from femfit.effects.effect import AddedEffect
from femfit.field.eddy_probe import EddyProbe
from femfit.field.eddy_sweep import ORDER
from femfit.field.signature_rows import impedance_slopes
from femfit.model.with_effects import with_effects
from femfit.tables.eddy_table import IMPEDANCES, NAME, read_eddy
from femfit.tables.signatures import SLOPES_NAME
from femfit.tables.sweep_table import read_sweep_table
from support.eddy_transient import mesh_for
from support.small_drawing import POT

FEW = POT.replace("[1, 1.5, 2, 2.5]", "[1, 1.5, 2.5]")
AT_SIX = POT.replace("distance_mm = [1, 1.5, 2, 2.5]", "distance_mm = [1, 1.25, 1.5, 1.75, 2, 2.5]")
"""As many distances as a co-energy needs."""


@pytest.fixture(scope="module")
def actuator():
    return actuator_from_toml(FEW)


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    directory = tmp_path_factory.mktemp("eddy-pot")
    (directory / "pot.toml").write_text(FEW)
    return directory / "run", run_sweep(directory / "pot.toml", directory / "run", workers=2, signatures=True)


def test_patterns_give_the_direct_solution_on_another_mesh_and_at_other_frequencies(actuator, swept):
    _, table = swept
    distance = actuator.sweep.distances_m[1]
    moving = mesh_for(actuator, distance, 1000.0)
    exact, _ = EddyProbe(actuator, moving, distance, ORDER).transfers(np.array([20.0, 200.0, 900.0]))
    departures = table.eddy.transfers(1, exact.frequencies_Hz).departures(exact)
    assert departures.max() < 0.004  # an own mesh, frequencies between those of the patterns
    assert np.abs(exact.flux_linkage[-1, 0, 0]) < 0.7 * np.abs(exact.flux_linkage[0, 0, 0])  # there is an effect


def test_forms_are_symmetric_and_positive_with_small_errors_those_of_motion_too(swept):
    eddy = swept[1].eddy
    assert 0.0 < eddy.errors[:, 0].max() < 0.01
    assert eddy.braking_error < 0.5 * eddy.asked_error
    among = eddy.flux_linkage[:, :, 1:]
    assert np.abs(among - among.swapaxes(1, 2)).max() < 1e-12 * np.abs(among).max()
    assert np.linalg.eigvalsh(among).min() > 0.0
    at_rest = swept[1].rows.query("current_A == 0.0")["inductance_H"].to_numpy()
    assert among[:, 0, 0] == pytest.approx(at_rest, rel=1e-3)  # of another mesh


def test_impedance_file_has_every_distance_bias_and_frequency(swept, actuator):
    directory, table = swept
    rows = pd.read_csv(directory / IMPEDANCES)
    assert len(rows) == 3 * 3 * len(actuator.frequencies_Hz)
    assert set(rows) >= {"resistance_ohm", "inductance_H", "force_real_N_per_A", "hall_imag_T_per_A", "force_error"}
    near = rows[(rows["distance_m"] == 0.001) & (rows["current_A"] == 1.0)]
    assert np.all(np.diff(near["resistance_ohm"]) > 0.0)
    assert np.all(np.diff(near["inductance_H"]) < 0.0)
    slope = table.rows.set_index(["distance_m", "current_A"])["force_N"][0.001]
    at_rest = slope[1.0] - slope[-1.0]  # of a parabola: twice its linear term
    mean = rows[(rows["distance_m"] == 0.001) & (rows["current_A"] == 0.0)]["force_real_N_per_A"].iloc[0]
    assert mean == pytest.approx(0.5 * at_rest, rel=0.02)  # 10 Hz


def test_a_finished_sweep_solves_nothing_again(swept, monkeypatch):
    directory, table = swept
    monkeypatch.setattr("femfit.field.sweep_task.ProbeTask.result", None)
    monkeypatch.setattr("femfit.field.sweep_task.FormsTask.result", None)
    again = run_sweep(directory.parent / "pot.toml", directory, workers=1)
    assert np.array_equal(again.eddy.force, table.eddy.force)
    assert np.array_equal(read_sweep_table(directory).eddy.flux_linkage, table.eddy.flux_linkage)


def test_distances_without_eddy_currents_are_named(swept):
    table = swept[1]
    assert table.still_mm == ()
    left = replace(table.eddy, distances_m=table.eddy.distances_m[[0, 2]])
    assert replace(table, eddy=left).still_mm == (1.5,)


def test_a_damaged_file_says_so(tmp_path, swept):
    whole = (swept[0] / NAME).read_bytes()
    for content in (b"PK\x03\x04 not whole", b"", b"text", whole[: len(whole) // 2]):
        (tmp_path / NAME).write_bytes(content)
        with pytest.raises(TableError, match="Sweep again"):
            read_eddy(tmp_path)


def test_without_frequencies_nothing_is_written(actuator, tmp_path):
    (tmp_path / NAME).write_bytes(b"of an earlier drawing")
    plain = replace(actuator, frequencies_Hz=(), sweep=replace(actuator.sweep, distances_m=(1e-3,)))
    assert run_sweep(plain, tmp_path, workers=1).eddy is None
    assert not (tmp_path / NAME).exists()


def test_a_sweep_with_frequencies_has_them_and_its_conductivity_is_that_of_the_patterns(swept):
    directory, table = swept
    slopes = read_sweep_table(directory).impedance_slopes
    assert slopes.numbers == table.impedance_slopes.numbers
    np.testing.assert_array_equal(slopes.slopes, table.impedance_slopes.slopes)
    at_rest = [one.key for one in table.signatures.numbers]
    assert [one.key for one in slopes.numbers if one.key not in at_rest] == ["materials.iron.conductivity_MS_per_m"]
    (place,) = [k for k, one in enumerate(slopes.numbers) if one.kind == "conductivity"]
    s = 2j * np.pi * slopes.frequencies_Hz
    for distance, exact in zip(slopes.distances_m, slopes.slopes[place, :, :, 0, 0], strict=True):
        (k,) = np.flatnonzero(table.eddy.distances_m == distance)
        by_patterns = table.eddy.conductivity_changes(0, int(k), slopes.frequencies_Hz)[0][:, 0, 0] / s
        assert np.abs(by_patterns - exact).max() < 0.02 * np.abs(exact).max()


def test_at_a_low_frequency_slopes_are_those_at_rest(actuator, swept):
    signatures, distance = swept[1].signatures, 0.0015
    numbers = [one for one in numbers_from_toml(FEW) if one.facts in signatures.numbers]
    f = np.array([0.01])
    moving = mesh_for(actuator, distance, f[0])
    probe = EddyProbe(actuator, moving, distance, ORDER)
    transfers, fields = probe.transfers(f)
    slopes = impedance_slopes(actuator, numbers, moving, probe.points.space, distance, f, fields)[:, 0, 0, 0]
    base = transfers.flux_linkage
    for number, slope in zip(numbers, slopes, strict=True):
        rows = signatures.of(number.facts)
        here = rows[rows["distance_m"] == distance].set_index("current_A")["flux_linkage_Wb"]
        at_rest = 0.5 * (here[1.0] - here[-1.0])
        # The sweep's mesh has no skin layers and another order
        off = abs(slope - at_rest) * number.facts.tolerance
        assert off < 0.01 * abs(at_rest) * number.facts.tolerance + 1e-4 * abs(base[0, 0, 0]), number.facts.key


@pytest.mark.nightly
def test_a_model_changes_with_a_number_as_the_field_does(tmp_path):
    (tmp_path / "pot.toml").write_text(AT_SIX)
    table = run_sweep(tmp_path / "pot.toml", tmp_path / "run", workers=2, signatures=True)
    slopes, model = table.impedance_slopes, fit_model(table).model
    compared = [one for one in slopes.numbers if not one.effect and one.kind != "hall_place"]
    assert {one.key for one in model.drawn if one.impedance or one.conducts} == {one.key for one in compared}
    f = slopes.frequencies_Hz
    for number, by_number in zip(slopes.numbers, slopes.slopes[..., 0, 0], strict=True):
        if number not in compared:
            continue
        (drawn,) = [one for one in model.drawn if one.key == number.key]
        size = 1e-4 * number.tolerance
        changed = with_effects(model, [AddedEffect(drawn.effect, {drawn.parameter: size})])
        for distance, slope in zip(slopes.distances_m, by_number, strict=True):
            z, expected = model.impedance(distance, 0.0, f), 2j * np.pi * f * slope
            change = (changed.impedance(distance, 0.0, f) - z) / size
            # The conductivity by the patterns, which are 2 % off; some numbers are seen by rounding alone
            limit = (0.02 if number.kind == "conductivity" else 1e-3) * np.abs(expected).max()
            assert np.all(np.abs(change - expected) < limit + 1e-6 * np.abs(z) / number.tolerance), number.key


def test_the_slopes_file_stays_for_the_same_drawing_and_goes_with_another(swept, tmp_path):
    shutil.copytree(swept[0].parent, tmp_path, dirs_exist_ok=True)
    drawing, file = tmp_path / "pot.toml", tmp_path / "run" / SLOPES_NAME
    run_sweep(drawing, tmp_path / "run", workers=1)
    assert file.is_file()
    drawing.write_text(re.sub("distance_mm = .*", "distance_mm = [1]", re.sub("frequency_Hz = .*", "", FEW)))
    run_sweep(drawing, tmp_path / "run", workers=1)
    assert not file.exists()
