"""The trial of a solenoid and a voice coil makes its truth by other physics, and counts what was said of it."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.device.load import read_actuator
from femfit.effects.catalogue import all_effects
from support.device_trial.bench import bench_campaign
from support.device_trial.causes import BENCH, CLEAN, RECORDS
from support.device_trial.drawings import DRAWN, FORMS, SETTINGS, write_drawing, write_model_drawing
from support.device_trial.motion import SAMPLE_STEPS, STEP_S, Physics, dry, simulate
from support.device_trial.run import Outcome, table_lines
from support.device_trial.tables import FormTable, SolvedDevice
from support.solenoids import solenoid


@pytest.mark.parametrize(("device", "form"), [(device, form) for device in FORMS for form in FORMS[device]])
def test_every_form_is_a_drawing_that_is_read(device, form, tmp_path):
    changed = read_actuator(write_drawing(device, form, tmp_path))
    currents, distances = SETTINGS[device]
    assert changed.sweep.currents_A == currents
    assert np.allclose(changed.sweep.distances_m, 1e-3 * np.array(distances))
    assert form == DRAWN or changed != read_actuator(write_drawing(device, DRAWN, tmp_path))


def test_right_names_are_of_the_catalogue():
    assert {name for cause in (*BENCH, *RECORDS) for name in cause.names} <= set(all_effects())


def solved(tmp_path):
    """A solenoid in closed form in place of the drawn field, with 3 % fewer turns as one of its forms."""
    model = solenoid()
    currents, distances = SETTINGS["solenoid"]
    d, i = np.meshgrid(1e-3 * np.array(distances), np.array(currents), indexing="ij")
    magnetics, ohms = model.magnetics, model.circuit.resistance_ohm
    forms = {
        DRAWN: FormTable(magnetics.force(d, i), magnetics.flux_linkage(d, i), ohms),
        "shorted_turns": FormTable(
            magnetics.force(d, 0.97 * i), 0.97 * magnetics.flux_linkage(d, 0.97 * i), 0.97 * ohms
        ),
    }
    actuator = read_actuator(write_model_drawing("solenoid", tmp_path))
    return SolvedDevice("solenoid", actuator, model, forms)


def test_a_bench_reads_the_solved_field_of_its_form(tmp_path):
    device, cause = solved(tmp_path), next(cause for cause in BENCH if cause.name == "shorted_turns")
    seed = [3, 1]
    clean, hidden = (bench_campaign(device, one, np.random.default_rng(seed)) for one in (None, cause))
    assert clean.over_noise == 0.0
    assert hidden.over_noise > 1.0
    largest = clean.rows["force_N"].idxmax()
    ratio = hidden.rows["force_N"][largest] / clean.rows["force_N"][largest]
    assert 0.9 < ratio < 1.0


def test_the_current_settles_at_the_command_over_the_resistance_and_the_body_on_its_stop(tmp_path):
    device = solved(tmp_path)
    physics = Physics(
        mass_kg=0.02, push=lambda _d: 0.1, drag=dry(0.05), ends_m=(0.2e-3, 4e-3), resistance_ohm=12.0, one_sided=True
    )
    rows = simulate(device, physics, np.full(1800, 6.0), 4e-3)
    assert rows["current_A"].iloc[-1] == pytest.approx(0.5, rel=0.01)
    assert rows["distance_m"].iloc[-1] == pytest.approx(0.2e-3, abs=5e-6)
    assert rows["time_s"].iloc[1] == pytest.approx(SAMPLE_STEPS * STEP_S)


def test_a_one_sided_driver_lets_the_current_die_and_not_turn_round(tmp_path):
    physics = Physics(0.02, lambda _d: 0.1, dry(0.05), (0.2e-3, 4e-3), 12.0, one_sided=True)
    rows = simulate(solved(tmp_path), physics, np.r_[np.full(300, 6.0), np.zeros(1500)], 4e-3)
    assert rows["current_A"].min() == 0.0
    assert rows["current_A"].iloc[-1] == 0.0


def outcome(**changes):
    plain = Outcome("solenoid", "bench", "shorted_turns", ("turns",), 5.0, "named", (("turns",),), True)
    return replace(plain, **changes)


def test_what_was_said_is_counted_by_what_would_have_been_right():
    wrong = outcome(classes=(("current_gain",),))
    foreign = outcome(hidden="back_gap", right=())
    invisible = outcome(over_noise=0.3, classes=())
    clean = outcome(hidden=CLEAN, right=(), over_noise=0.0, verdict="nothing_missing", classes=(), confident=False)
    assert (outcome().in_class, outcome().certain_and_wrong) == (True, False)
    assert (wrong.in_class, wrong.certain_and_wrong) == (False, True)
    assert foreign.certain_and_wrong
    assert not replace(foreign, confident=False).certain_and_wrong
    lines = table_lines([outcome(), wrong, foreign, invisible, clean])
    shown = {outcome: next(line for line in lines if outcome in line) for outcome in ("something named", "right name")}
    assert "0 of 1 " in shown["something named"]
    assert "1 of 2 " in shown["right name"]
