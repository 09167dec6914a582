"""What the drawing's numbers change, from the solved field: against Euler's theorem and against other drawings."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

import femfit.device.drawn_numbers as drawn_numbers_module
from femfit.core.errors import ActuatorFileError, UsageError
from femfit.device.drawn_numbers import numbers_from_toml, read_numbers
from femfit.device.load import actuator_from_toml, read_actuator
from femfit.field.eddy_probe import EddyProbe
from femfit.field.eddy_sweep import ORDER
from femfit.field.layout import layout_of, stretch_groups
from femfit.field.problem import prepare
from femfit.field.signature_rows import impedance_slopes
from femfit.field.sweep import run_sweep
from femfit.field.tolerance import SolverSettings
from femfit.tables.sweep_table import read_sweep_table
from support.actuators import GEOMETRY
from support.eddy_transient import mesh_for
from support.small_drawing import POT, SMALL

FINE = SolverSettings(order=6, corner_fraction=0.01)
COLUMNS = {"force_N": 2, "flux_linkage_Wb": 2, "hall_T": 0}
"""Channels, and the power of a common factor of all lengths and currents that each grows with."""


def _problem(actuator, distances, settings=FINE):
    return prepare(actuator, distances, layout_of(actuator, settings), settings)


def _table(problem, distance, currents):
    rows = problem.rows(distance, currents)
    return np.array([rows[name] for name in COLUMNS if name in rows]).T


@pytest.mark.parametrize(
    ("name", "distance", "current"),
    [
        ("emaws-rig", 0.022, 1.0),  # magnet and Hall element
        ("ball", 0.005, 1.0),  # arcs and saturation
        # a bore, and a moving coil in a saturating magnet system, where every distance has its own mesh
        pytest.param("plunger-solenoid", 0.002, 1.0, marks=pytest.mark.nightly),
        pytest.param("voice-coil", -0.006, 2.0, marks=pytest.mark.nightly),
    ],
)
def test_scaling_of_all_lengths_and_currents(name, distance, current):
    """Euler's theorem: twice as large with twice the current has the same B everywhere.

    The sum over all lengths of length times slope, with d dF/dd and i dF/di, is twice the force, twice the flux
    linkage, and nothing for B. Where one mesh does not serve several distances, their noise is 0.1 % of the force.
    """
    actuator, numbers = read_actuator(GEOMETRY / f"{name}.toml"), read_numbers(GEOMETRY / f"{name}.toml")
    layout = layout_of(actuator, FINE)
    near = tuple(distance + k * 2e-3 * layout.clearance for k in (-1, 0, 1))
    shared = len(stretch_groups(near, layout, FINE)) == 1
    step, step_i = (2e-3 if shared else 2e-2) * layout.clearance, 0.01 * current
    ends = (distance - step, distance, distance + step)
    problem = _problem(actuator, ends if shared else (distance,))
    low, high = (_table(problem if shared else _problem(actuator, (d,)), d, [current])[0] for d in ends[::2])
    below, here, above = _table(problem, distance, [current - step_i, current, current + step_i])
    (slopes,) = problem.signatures(distance, [current], numbers)
    lengths = np.array([number.facts.value if number.facts.unit == "mm" else 0.0 for number in numbers])
    total = lengths @ slopes + distance * (high - low) / (2.0 * step) + current * (above - below) / (2.0 * step_i)
    powers = np.array(list(COLUMNS.values())[: len(here)])
    assert np.abs(total - powers * here).max() > 0.0
    assert np.all(np.abs(total - powers * here) <= 1.5e-3 * np.abs(here))


WHOLE = {
    "emaws-rig": (0.022, [0.0, 1.4], {
        "fixed.regions.lower_flange.r_mm[1]": 0.05,
        "fixed.regions.sleeve.z_mm[1]": 0.05,
        "moving.regions.magnet.z_mm[1]": 0.05,
        "materials.n52.relative_permeability": 0.01,
        "sensors.hall.z_mm": 0.02,
    }),
    "ball": (0.005, [0.5, 2.0], {
        "moving.regions.ball.circle_mm[2]": 0.05,
        "fixed.regions.core.r_mm[1]": 0.05,
        "coils.coil.r_mm[0]": 0.05,
        "materials.steel_1010.B_T": 0.005,
        "materials.steel_1010.H_A_per_m": 0.01,
    }),
    "voice-coil": (-0.006, [-3.0, 3.0], {
        "coils.voice.z_mm[1]": 0.05,
        "fixed.regions.pole.r_mm[1]": 0.02,  # a face that the magnet below shares, which stays
        "fixed.regions.magnet.z_mm[1]": 0.02,  # a joint
    }),
    "magnet-pair": (0.01, [0.0], {"fixed.regions.lower.r_mm[1]": 0.05, "moving.regions.upper.z_mm[1]": 0.05}),
}  # fmt: skip
"""By drawing: distance, currents, and the numbers that are moved, by how much."""


@pytest.mark.nightly
@pytest.mark.parametrize("name", WHOLE)
def test_slopes_are_those_of_whole_new_solutions(name, monkeypatch):
    """To a thousandth of the largest change that any of the chosen numbers makes within its tolerance."""
    path, (distance, currents, chosen) = GEOMETRY / f"{name}.toml", WHOLE[name]
    numbers = [one for one in read_numbers(path) if one.facts.key in chosen]
    assert len(numbers) == len(chosen)
    slopes = _problem(read_actuator(path), (distance,)).signatures(distance, currents, numbers)
    changes = []
    for number in numbers:
        step = chosen[number.facts.key]
        monkeypatch.setattr("femfit.device.drawn_numbers.STEP", {"mm": step})
        monkeypatch.setattr("femfit.device.drawn_numbers.SHARE_STEP", step)
        (wide,) = (one for one in read_numbers(path) if one.facts.key == number.facts.key)
        high, low = (_table(_problem(one, (distance,)), distance, currents) for one in (wide.larger, wide.smaller))
        changes.append((high - low) / (2.0 * step))
    tolerance = np.array([number.facts.tolerance for number in numbers])[:, None]
    expected, found = np.stack(changes, axis=1), slopes
    largest = np.abs(tolerance * expected).max(axis=(0, 1))
    assert np.all(np.abs(tolerance * (found - expected)) <= 1e-3 * largest)


def test_what_two_equal_coils_change_is_mirrored():
    """An axial bearing in the middle of its gaps: each number of one side is that of the other with another sign."""
    path = GEOMETRY / "bearing.toml"
    numbers, actuator = read_numbers(path), read_actuator(path)
    (slopes,) = _problem(actuator, (5e-4,), SolverSettings(order=4)).signatures(5e-4, [[2.0, 2.0]], numbers)
    rows = {number.facts.key: row for number, row in zip(numbers, slopes, strict=True)}
    largest = np.abs(slopes).max(axis=0)
    for corner, axis, sign in ((1, 0, 1.0), (3, 0, 1.0), (5, 0, 1.0), (4, 1, -1.0), (6, 1, -1.0)):
        lower, upper = (rows[f"fixed.regions.{side}.polygon_mm[{corner}][{axis}]"] for side in ("lower", "upper"))
        assert np.all(np.abs(lower * [-1.0, 1.0, 1.0] - sign * upper[[0, 2, 1]]) <= 1e-3 * largest)


def test_a_sweep_writes_signatures_beside_its_table_that_stays_as_it_is_and_reads_them_back(small_sweep, tmp_path):
    shutil.copytree(small_sweep, tmp_path, dirs_exist_ok=True)
    drawing = tmp_path / "small.toml"
    table = run_sweep(drawing, tmp_path / "run", workers=1, signatures=True)  # which is there
    again = read_sweep_table(tmp_path / "run").signatures
    assert again.numbers == table.signatures.numbers
    assert len(again.rows) == len(again.numbers) * len(table.rows)
    np.testing.assert_array_equal(again.rows["force_N"], table.signatures.rows["force_N"])
    plain = run_sweep(drawing, tmp_path / "plain", workers=1).rows
    np.testing.assert_array_equal(plain["force_N"], table.rows["force_N"])
    by_key = {one.key: one for one in again.numbers}
    assert by_key["fixed.regions.core.r_mm[1]"].tolerance == 0.01
    assert by_key["moving.regions.magnet.z_mm[1]"].tolerance == 0.03
    assert by_key["materials.iron.relative_permeability"].tolerance == pytest.approx(0.1)
    run_sweep(drawing, tmp_path / "run", workers=1)
    assert read_sweep_table(tmp_path / "run").signatures.numbers == again.numbers  # of the same drawing
    drawing.write_text(SMALL.replace("turns = ", "turns = 1"))
    run_sweep(drawing, tmp_path / "run", workers=1)
    assert read_sweep_table(tmp_path / "run").signatures is None  # those of a sweep that is no more


def test_signatures_of_what_is_no_file_are_refused(tmp_path):
    with pytest.raises(UsageError, match="actuator file"):
        run_sweep(read_actuator(GEOMETRY / "ball.toml"), tmp_path, signatures=True)


@pytest.mark.parametrize(
    ("tables", "complaint"),
    [
        ('[tolerances]\n"fixed.regions.core.r_mm[7]" = 0.1', "key path"),
        ('[tolerances]\n"coils.coil.r_mm[1]" = -1', "> 0"),
        ("[tolerances]\nlength_mm = 0", "greater"),
        ('[sweep.parameters]\n"coils.coil.turns" = [90, 100]', r"sweep\.parameters"),
    ],
)
def test_tolerances_that_say_nothing_and_swept_parameters_are_refused(tables, complaint):
    with pytest.raises(ActuatorFileError, match=complaint):
        numbers_from_toml(SMALL.split("[tolerances]", maxsplit=1)[0] + f"{tables}\n")


POT_MAGNET = (GEOMETRY / "pot-magnet.toml").read_text()

RINGED = (
    POT.replace(
        "[fixed.regions.pot]",
        """
[materials.copper]
relative_permeability = 1
conductivity_MS_per_m = 58

[materials.sheets]
relative_permeability = 500
conductivity_MS_per_m = 2
lamination_mm = 0.5

[fixed.regions.ring]
material = "copper"
r_mm = [5.2, 9.3]
z_mm = [-1.8, -1.2]

[fixed.regions.pot]""",
    )
    .replace('[moving.regions.disc]\nmaterial = "iron"', '[moving.regions.disc]\nmaterial = "sheets"')
    .replace("remanence_T", "conductivity_MS_per_m = 0.7\nremanence_T")
)
"""A pot with a copper ring, a disc of sheets and a magnet that conducts: every kind of number."""

MESH_NOISE = (8e-5,) * 3  # of L: two meshes of the pot differ by 1e-5 to 6e-5 of it
# Those of the pot magnet by 6e-6 at 10 Hz, 9e-5 at 300 Hz and 1.23e-4 at 5 kHz, where the flux is left in a thin skin
MESH_NOISE_HIGH = (1e-5, 1e-4, 1.3e-4)
SECOND_ORDER = 0.02  # of a difference, by the steps below


def solved(actuator, distance, frequencies):
    moving = mesh_for(actuator, distance, frequencies[-1])
    probe = EddyProbe(actuator, moving, distance, ORDER)
    transfers, fields = probe.transfers(frequencies)
    return transfers.flux_linkage, fields, moving, probe.points.space


LOW, HIGH = (10.0, 100.0, 1000.0), (10.0, 300.0, 5000.0)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("text", "frequencies", "mesh_noise"),
    [(RINGED, LOW, MESH_NOISE), (POT_MAGNET, HIGH, MESH_NOISE_HIGH)],
    ids=["ringed", "pot-magnet"],
)
def test_slopes_are_those_between_drawings(monkeypatch, text, frequencies, mesh_noise):
    actuator, f = actuator_from_toml(text), np.array(frequencies)
    share = np.reshape(mesh_noise, (-1, 1, 1))
    numbers = numbers_from_toml(text, harmonic=True)
    monkeypatch.setitem(drawn_numbers_module.STEP, "mm", 0.05)
    monkeypatch.setattr(drawn_numbers_module, "SHARE_STEP", 0.02)
    farther = {one.facts.key: one for one in numbers_from_toml(text, harmonic=True)}
    compared = 0
    distances = actuator.sweep.distances_m[1::2]
    for distance in distances:
        base, fields, moving, space = solved(actuator, distance, f)
        slopes = impedance_slopes(actuator, numbers, moving, space, distance, f, fields)
        for number, slope in zip(numbers, slopes, strict=True):
            far = farther[number.facts.key]
            larger, smaller = (solved(one, distance, f)[0] for one in (far.larger, far.smaller))
            change, expected = slope * 2.0 * far.step, larger - smaller
            # Another material is on the same mesh
            noise = np.abs(base) * (1e-8 if number.facts.key.startswith("materials.") else share)
            assert np.all(np.abs(change - expected) < noise + SECOND_ORDER * np.abs(expected)), number.facts.key
            compared += bool(np.any(np.abs(expected) > 10.0 * noise))
    assert compared >= 8 * len(distances)  # most numbers change more than the meshes do


def test_mutual_slopes_are_symmetric_and_add_up_to_those_of_the_windings_in_series():
    currents = "current_A = { winding = [0, 1], further = [0, 1] }"
    lower, upper = "r_mm = [5.5, 9]\nz_mm = [-8.5, -5.5]", "r_mm = [5.5, 9]\nz_mm = [-5, -2]"
    further = f"[coils.further]\n{upper}\nturns = 110\nresistance_ohm = 2\n\n[moving.regions.disc]"
    text = RINGED.replace("r_mm = [5.5, 9]\nz_mm = [-8.5, -2]", lower).replace("[moving.regions.disc]", further)
    text = text.replace("current_A = [-1, 0, 1]", currents)
    drawn, f, d = numbers_from_toml(text, harmonic=True), np.array([50.0, 500.0]), 0.0015
    apart, numbers = _apart(actuator_from_toml(text)), _each(drawn, _apart)
    series = _in_series(apart)
    inductance, fields, moving, space = solved(apart, d, f)
    slopes = impedance_slopes(apart, numbers, moving, space, d, f, fields)
    assert slopes.shape == (len(numbers), 2, 2, 2)
    np.testing.assert_array_equal(slopes, slopes.swapaxes(2, 3))
    in_series, both = _each(drawn, _in_series), fields.sum(axis=1, keepdims=True)
    together = impedance_slopes(series, in_series, moving, space, d, f, both)[:, :, 0, 0]
    size = np.abs(inductance).max()
    np.testing.assert_allclose(slopes.sum(axis=(2, 3)), together, atol=1e-10 * size)


def _each(numbers, change):
    return tuple(replace(one, larger=change(one.larger), smaller=change(one.smaller)) for one in numbers)


def _apart(actuator):
    coils = tuple(replace(one, circuit=one.name) for one in actuator.coils)
    return replace(actuator, coils=coils, circuits=tuple(replace(actuator.circuits[0], name=c.name) for c in coils))


def _in_series(actuator):
    coils = tuple(replace(one, circuit="all") for one in actuator.coils)
    return replace(actuator, coils=coils, circuits=(replace(actuator.circuits[0], name="all"),))
