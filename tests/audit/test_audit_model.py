"""A consistent model passes its audit; a model that contradicts itself does not."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.audit.audit_model import audit_model
from femfit.model.actuator_model import Circuit, Motion
from femfit.model.json_file import write_model
from femfit.model.magnetics import Coefficient, LawMagnetics
from support.command import femfit


def codes(model, *severities):
    return {one.code for one in audit_model(model) if one.severity in severities}


def law(model, **change):
    first = Coefficient("d^-4", 0, 4.2e-9, "N m^4")
    second = replace(Coefficient("d^-2", 1, 3.6e-5, "N m^2 / A"), **change)
    return replace(model, magnetics=LawMagnetics("F1e", (first, second), {}, 0.0162), misfit=None)


def test_a_consistent_rig_passes_clean(levitation_model):
    assert codes(levitation_model, "wrong", "note") == set()
    checked = codes(levitation_model, "holds")
    assert {"reciprocity", "inductance", "held_range", "sample_time", "hall_range", "single_precision"} <= checked


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda m: replace(m, reference_distances_m=(0.022, 0.044)), "held_range"),
        (lambda m: replace(m, sample_time_s=0.02), "sample_time"),
        (lambda m: replace(m, circuit=Circuit(2.69, 3.0, 0.5)), "positive"),
        (lambda m: replace(m, motion=Motion(-1e-3)), "positive"),
        (lambda m: replace(law(m), magnetics=replace(law(m).magnetics, constant_inductance_H=0.0)), "inductance"),
        (lambda m: law(m, value=3.6e-5, bounds=(0.0, 1e-7)), "outside_bounds"),
    ],
)
def test_each_contradiction_is_found(levitation_model, change, code):
    assert code in codes(change(levitation_model), "wrong")


def test_a_bound_that_decided_and_a_large_misfit_are_noted(levitation_model):
    model = law(levitation_model, value=0.0, bounds=(0.0, np.inf), active="lower")
    large = replace(levitation_model.misfit, force_rms_of_weight=0.07)
    assert {"active_bound", "attraction", "misfit"} <= codes(replace(model, misfit=large), "note")


def test_steel_without_a_magnet_is_not_said_to_attract_less(levitation_model):
    pot = LawMagnetics("F1e", (Coefficient("d^-2", 2, 2e-5, "N m^2 / A^2"),), {}, 0.03)
    assert "attraction" in codes(replace(levitation_model, magnetics=pot, sensor=None, misfit=None), "holds")


def test_a_hall_output_that_leaves_its_range_is_noted(levitation_model):
    sensor = replace(levitation_model.sensor, sensitivity_V_per_T=500.0)
    assert "hall_range" in codes(replace(levitation_model, sensor=sensor), "note")


def test_the_command_audits_models_and_parameter_sets(levitation_model, tmp_path):
    write_model(levitation_model, tmp_path / "model.json")
    done = femfit("audit", tmp_path / "model.json", "--json", tmp_path / "a.json")
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip().endswith("0 wrong, 0 to look at, 9 recomputed and right")
    assert (tmp_path / "a.json").read_text().count('"holds"') == 9
    assert femfit("audit", tmp_path / "nothing.toml").returncode == 1
