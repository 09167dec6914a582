"""A consistent model passes its audit; a model that contradicts itself does not."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from femfit.audit.audit_model import audit_model
from femfit.device.mechanics import Stop
from femfit.fit.build import fit_model
from femfit.fit.ranking import as_written
from femfit.model.json_file import read_model, write_model
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.model.validity import ValidityBox
from femfit.tables.sweep_table import write_sweep_table
from support.closed_forms import FEW, NARROW, VALVE
from support.command import femfit
from support.levitation import STEEL
from support.parts import with_motion, with_sensor
from support.sweeps import full_table


def codes(model, *severities):
    return {one.code for one in audit_model(model).findings if one.severity in severities}


def law(model, **change):
    first = Coefficient("d^-4", 0, 4.2e-9, "N m^4")
    second = replace(Coefficient("d^-2", 1, 3.6e-5, "N m^2 / A"), **change)
    return replace(model, magnetics=LawMagnetics("F1e", (first, second), {}, 0.0162), misfit=None)


def test_a_consistent_rig_passes_clean(levitation_model):
    assert codes(levitation_model, "wrong", "note") == set()
    assert codes(levitation_model, "stated") == {"misfit"}  # no table is at hand
    assert {"inductance", "held_range", "sample_time", "hall_range"} <= codes(levitation_model, "holds")


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda m: replace(m, reference_distances_m=(0.022, 0.044)), "held_range"),
        (lambda m: replace(m, sample_time_s=0.02), "sample_time"),
        (lambda m: replace(law(m), magnetics=replace(law(m).magnetics, constant_inductance_H=0.0)), "inductance"),
        (lambda m: law(m, value=3.6e-5, bounds=(0.0, 1e-7)), "outside_bounds"),
    ],
)
def test_each_contradiction_is_found(levitation_model, change, code):
    assert code in codes(change(levitation_model), "wrong")


def test_a_bound_that_decided_is_noted(levitation_model):
    model = law(levitation_model, value=0.0, bounds=(0.0, np.inf), active="lower")
    assert {"active_bound", "attraction"} <= codes(model, "note")


def test_steel_without_a_magnet_is_not_said_to_attract_less(levitation_model):
    both = ValidityBox.of_currents((0.016, 0.03), (-2.0, 2.0))  # of which either sign attracts
    model = replace(levitation_model, magnetics=STEEL, sensor=None, misfit=None, validity=both)
    assert "attraction" in codes(model, "holds")


def test_a_hall_output_that_leaves_its_range_is_noted(levitation_model):
    model, box = with_sensor(levitation_model, sensitivity_V_per_T=500.0), levitation_model.validity
    (found,) = [one for one in audit_model(model).findings if one.code == "hall_range"]
    assert found.severity == "note"
    distance = np.linspace(box.distance_min_m, box.distance_max_m, 4001)
    currents = np.linspace(*box.current_limits_A[0], 9)
    volts = [model.sensor.voltage(distance, np.full(4001, current)) for current in currents]
    farthest = distance[np.max(volts, axis=0) >= 5.0].max()
    begins, ends = map(float, found.sentence.split("clipped at 5 V from ")[1].split(" mm at some")[0].split(" to "))
    assert begins == pytest.approx(1e3 * box.distance_min_m)
    assert ends == pytest.approx(1e3 * farthest, abs=0.75)  # a step of the grid


def scaled(model, length):
    """The same device, longer by a factor: forces and masses as they were."""
    law = LawMagnetics("F1e", (Coefficient("d^-2", 1, 3.6e-5 * length**2, "N m^2 / A"),), {}, 0.0162 * length)
    box = replace(model.validity, distance_min_m=length * 0.015, distance_max_m=length * 0.045)
    steps = tuple(length * d for d in (0.022, 0.030))
    misfit = replace(model.misfit, force_rms_N=1e-4, flux_linkage_rms_Wb=None, inductance_rms_H=None, force_share=None)
    others = {"sample_time_s": 5e-4 * np.sqrt(length), "misfit": misfit, "sensor": None}
    return replace(model, magnetics=law, validity=box, reference_distances_m=steps, **others)


@pytest.mark.parametrize("length", [1e-3, 100.0])
def test_a_verdict_does_not_depend_on_the_size_of_the_device(levitation_model, length):
    audits = (audit_model(scaled(levitation_model, one)) for one in (1.0, length))
    same, found = ({one.code: one.severity for one in audit.findings} for audit in audits)
    assert found == same


def test_the_stroke_of_a_held_body_ends_at_its_stops(levitation_model):
    model = with_motion(levitation_model, near_stop=Stop(0.02, 0.0), far_stop=Stop(0.03, 0.0))
    (found,) = [one for one in audit_model(model).findings if one.code == "held_range"]
    assert found.numbers["carried"][0]["range_m"] == [pytest.approx(0.02), 0.03]


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    directory = tmp_path_factory.mktemp("run")
    write_sweep_table(full_table(), directory)
    result = fit_model(directory)
    write_model(result.model, directory / "model.json")
    return directory, result.model


def test_a_model_is_compared_with_the_table_beside_it_where_it_holds(fitted, levitation_model):
    directory, model = fitted
    audit = audit_model(directory / "model.json")
    misfits = {one.about: one.severity for one in audit.findings if one.code == "misfit"}
    assert misfits == dict.fromkeys(("force", "flux linkage", "inductance"), "holds")
    base = model.magnetics
    weaker = replace(base, spline=replace(base.spline, coefficients=0.8 * base.spline.coefficients))
    write_model(replace(model, magnetics=weaker), directory / "weaker.json")
    wrong = {one.code: one for one in audit_model(directory / "weaker.json").findings if one.severity == "wrong"}
    assert wrong["misfit"].recomputed == pytest.approx(0.2, rel=0.01)
    assert "misfit" in codes(replace(model, magnetics=weaker), "stated")  # without its table: as the file states
    narrower = replace(model, validity=replace(model.validity, distance_max_m=0.04))
    write_model(narrower, directory / "narrower.json")
    inside = audit_model(directory / "narrower.json")
    assert {one.severity for one in inside.findings if one.code == "misfit"} == {"holds"}


def test_an_audit_says_of_a_coarse_sweep_and_of_inductances_what_the_fit_says():
    """A knee between six currents."""
    fit = fit_model(VALVE.table(FEW, NARROW))
    assert as_written(fit.model).misfit == fit.misfit
    fit = replace(fit, model=replace(fit.model, provenance={"fit": "edited by hand"}))
    (between,) = (finding for finding in audit_model(fit.model).findings if finding.code == "missed_between")
    (note,) = (note for note in fit.notes if "too coarse" in note)
    assert between.severity == "note"
    assert between.sentence.partition(" Add ")[2] == note.partition(" Add ")[2] != ""
    (inductance,) = (finding for finding in audit_model(fit.model).findings if finding.code == "inductance")
    assert inductance.sentence.removeprefix("the inductance is ").rstrip(".") in str(fit)


def test_a_damaged_table_beside_a_model_is_said(fitted, tmp_path):
    _, model = fitted
    write_model(model, tmp_path / "model.json")
    (tmp_path / "sweep.csv").write_text("distance_m,current_A\n0.01,oops\n")
    audit = audit_model(tmp_path / "model.json")
    assert [one.code for one in audit.findings if one.severity == "note" and one.about == "table"] == ["table"]
    assert {one.severity for one in audit.findings if one.code == "misfit"} == {"stated"}


@pytest.mark.parametrize(
    ("change", "needed"),
    [
        (lambda rows: rows.assign(distance_m=0.1 * rows["distance_m"]), "0 of"),
        (lambda rows: rows.assign(current_A=10.0 * rows["current_A"]), "where the model holds"),
        (lambda rows: rows.rename(columns={"current_A": "current_top_A"}), "current_A"),
        (lambda rows: rows.assign(current_top_A=rows["current_A"]), "current_top_A"),
        (lambda rows: rows.assign(force_N=0.0), "force_N is 0"),
    ],
)
def test_a_table_of_another_device_is_refused_with_what_does_not_match(fitted, tmp_path, change, needed):
    directory, _ = fitted
    table = full_table()
    write_sweep_table(replace(table, rows=change(table.rows)), tmp_path)
    done = femfit("audit", directory / "model.json", "--table", tmp_path)
    assert done.returncode == 1
    assert needed in done.stderr


def test_the_command_ends_with_1_where_something_is_wrong(levitation_model, tmp_path):
    write_model(replace(levitation_model, sample_time_s=0.02), tmp_path / "slow.json")
    done = femfit("audit", tmp_path / "slow.json")
    assert (done.returncode, done.stdout[:7]) == (1, "1 wrong")


@pytest.mark.parametrize("path", sorted((Path(__file__).parents[1] / "golden" / "inputs" / "models").glob("*.json")))
def test_every_finding_of_every_kind_of_device_that_is_too_heavy_has_its_sentence(path):
    model = read_model(path)
    audit = audit_model(model if model.motion is None else with_motion(model, mass_kg=50.0))
    for finding in json.loads(json.dumps(audit.to_dict(), allow_nan=False))["findings"]:
        assert finding["sentence"].endswith(".")
    assert len(str(audit).splitlines()) == len(audit.findings) + 1
