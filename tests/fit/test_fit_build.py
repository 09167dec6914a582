"""From a table to a model: the parts that its drawing gives, misfits, notes, and what is printed."""

import json
from dataclasses import asdict, replace

import numpy as np
import pandas as pd
import pytest

from femfit import SweepTable, fit_model, read_model, simulate, write_model
from femfit.core.errors import DomainError, MissingPartError, SimulationError, TableError
from femfit.device.electrics import Drive
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.fit.ranking import as_written, misfit_to_rows
from femfit.model.magnetics import LawMagnetics
from support.bearing import CIRCUITS, ENTRY, NAMES, table_of
from support.closed_forms import Saturating, fit_of, pair_table, steel_fit
from support.one_current import flat
from support.sweeps import ACTUATOR, MASS, ClosedForm, force_table, full_table
from support.sweeps import grid as plane

ONE_SIDE, BOTH_SIDES = (0.0, 1.0, 2.0, 3.0), (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)


def voice_coil(flux_linkage=None):
    """A coil in a gap: currents of both signs, a motional constant with a hump, 2 mH that saturate a little."""
    bent = ClosedForm(saturation=6.0)
    i, d = plane(np.linspace(-4.0, 4.0, 9), np.linspace(4e-3, 14e-3, 11))
    # Off the centre of the magnet's field the coil is driven less; its inductance falls with the distance
    force = (5.6 - 2.2e4 * (d - 9e-3) ** 2) * i + 1e-3 / 6e-3 * np.exp(-d / 6e-3) * bent._g(i, 0)
    flux = -5.6 * d + 2.2e4 * (d - 9e-3) ** 3 / 3.0 + (1e-3 + 1e-3 * np.exp(-d / 6e-3)) * bent._g(i, 1)
    rows = pd.DataFrame({"current_A": i, "distance_m": d, "force_N": force, "flux_linkage_Wb": flux, "status": "ok"})
    if flux_linkage is not None:
        rows["flux_linkage_Wb"] = flux_linkage(d, i)
    return SweepTable(rows, {"name": "voice-coil", "actuator": {"name": "voice-coil", "mass_kg": 0.012}})


@pytest.fixture(scope="module")
def ranked():
    return fit_model(voice_coil(), law="all")


@pytest.fixture(scope="module")
def disk():
    return fit_model(full_table(), law="dipole-disk")


def test_a_full_table_gives_a_complete_model():
    fit = fit_of("rig")
    model, box = fit.model, fit.model.validity
    assert (model.name, model.circuit.resistance_ohm, model.motion.mass_kg) == ("test-rig", 2.69, MASS)
    assert (model.sensor.adc_bits, model.reference_distances_m) == (12, (0.022, 0.03))
    assert (box.distance_min_m, box.distance_max_m, fit.notes) == (0.015, 0.045, ())
    assert (fit.misfit.against, fit.misfit.rows) == ("sweep", 488)
    assert fit.misfit.force_rms_of_weight < 1e-3
    assert fit.misfit.force_max_N >= fit.misfit.force_rms_N


def test_the_mechanics_and_the_drive_of_the_drawing_are_the_models():
    mechanics = Mechanics(MASS, 0.0, springs=(Spring(200.0, 0.8, 4e-3),), coulomb_N=0.05, far_stop=Stop(4e-3, 0.2))
    drive = {"kind": "voltage", "diode_V": 0.7, "bandwidth_Hz": None}
    circuit = {"name": "pair", "inductance_H": 1e-3, "drive": drive}
    entry = ACTUATOR | {"mechanics": asdict(mechanics), "circuits": [circuit]}
    model = fit_model(SweepTable(full_table().rows, {"actuator": json.loads(json.dumps(entry))})).model
    assert model.motion == mechanics
    assert model.circuit.drive == Drive(diode_V=0.7)
    assert (model.circuit.name, model.circuit.inductance_H) == ("pair", 1e-3)
    amplifier = {"kind": "current", "current_min_A": -1.0, "current_max_A": 2.0, "bandwidth_Hz": 500.0}
    options = {"mass_kg": 8e-3, "resistance_ohm": 5.0, "supply_V": (-6.0, 6.0)}
    model = fit_model(full_table(), actuator=entry | {"circuits": [{"drive": amplifier}]}, **options).model
    assert model.circuit.drive == Drive("current", None, -1.0, 2.0, 500.0)
    assert (model.motion.mass_kg, model.circuit.resistance_ohm, model.circuit.voltage_min_V) == (8e-3, 5.0, -6.0)


@pytest.mark.parametrize(
    ("length", "series_H", "period"), [(1.0, 0.0, 5e-4), (10.0, 0.0, 5e-3), (0.01, 0.0, 5e-6), (0.01, 0.05, 2e-5)]
)
def test_a_period_that_no_file_gives_follows_from_the_coil_and_the_body(length, series_H, period):
    # L/R is 16 mH / 2.69 ohm = 6 ms, ten times as much, a hundredth, and with 50 mH in series four times that
    actuator = {key: value for key, value in ACTUATOR.items() if key != "sample_time_s"}
    actuator |= {"resistance_ohm": 2.69 / length, "mass_kg": MASS * max(1.0, length) ** 2}
    actuator |= {"circuits": [{"name": "coil", "inductance_H": series_H}]}
    assert fit_model(full_table(actuator=actuator)).model.sample_time_s == pytest.approx(period)


def test_what_a_table_and_its_drawing_lack_is_said_with_what_to_give():
    bare = fit_model(full_table(actuator=None))
    assert (bare.model.circuit, bare.model.motion, bare.model.sensor) == (None, None, None)
    assert bare.model.misfit.force_rms_of_weight is None
    alone = force_table(ClosedForm().force, actuator=ACTUATOR)
    without, declared = fit_model(alone), fit_model(alone, law="F1e", inductance_H=16e-3)
    assert without.model.circuit is None
    assert declared.model.circuit is not None
    assert declared.model.magnetics.constant_inductance_H == 16e-3
    several = fit_model(table_of(entry={"name": "bare"}))
    hall = fit_model(table_of(entry={**ENTRY, "hall": {"sensitivity_V_per_T": 50.0}}))
    assert hall.model.sensor is None
    assert several.model.circuits == ()
    for fit, words in (
        (bare, "resistance_ohm, voltage_min_V, voltage_max_V unknown. Give --actuator"),
        (bare, "--mass-g"),
        (without, "--inductance-H since the table has no flux linkage"),
        (several, "lower, upper"),
        (hall, "Hall element"),
    ):
        assert sum(words in note for note in fit.notes) == 1, words
    pair = fit_model(pair_table(10))
    assert (pair.model.circuit, pair.misfit.rows) == (None, 10)
    assert not any("unknown" in note for note in pair.notes)
    with pytest.raises(DomainError):
        pair.model.force(0.01, 0.1)
    few = full_table(distances=np.linspace(0.015, 0.045, 4), currents=[0.0, 0.7, 1.4])
    assert fit_model(few, law="F1e").coenergy is None  # too small a table for one


def test_what_the_import_warned_of_is_passed_on():
    findings = [
        {"code": "assumed-units", "severity": "info", "sentence": "SI assumed: I in A.", "remedy": "Name it."},
        {"code": "reciprocity", "severity": "warning", "sentence": "current in mA read as A (accepted)", "remedy": ""},
        {"code": "noise", "severity": "info", "sentence": "The force is smooth.", "remedy": ""},
    ]
    fit = fit_model(SweepTable(full_table().rows, {"actuator": ACTUATOR, "findings": findings}))
    assert fit.of_data == ("SI assumed: I in A. Name it.", "current in mA read as A (accepted)")
    assert fit.to_dict()["notes"] == list(fit.of_data)


@pytest.mark.parametrize(("flux_linkage", "law", "wanted"), [
    # Flux linkages that the model misses: of a law, and of a co-energy since they turn from one distance to the next
    (lambda d, i: 3e-3 * np.tanh(i), "shifted-multipoles", "without --model"),
    (lambda d, i: 3e-3 * np.sin(4e3 * d) * i, None, "a sign or a unit"),
])  # fmt: skip
def test_a_circuit_that_the_model_does_not_hold_is_said_with_what_to_do(flux_linkage, law, wanted):
    table = voice_coil(flux_linkage)
    (note,) = (note for note in fit_model(table, law=law).notes if "do not simulate its circuit" in note)
    assert wanted in note
    assert ("without --model" in note) == (law is not None)


def test_a_misfit_counts_force_flux_linkage_and_inductance(disk):
    off = replace(disk.model.magnetics, constant_inductance_H=disk.model.magnetics.constant_inductance_H + 1e-3)
    misfit = misfit_to_rows(as_written(replace(disk.model, magnetics=off)), disk.rows)
    assert misfit.force_rms_N == disk.misfit.force_rms_N
    assert misfit.inductance_rms_H == pytest.approx(1e-3, rel=0.05)
    # 1 mH times the rms of 0 to 1.4 A
    assert misfit.flux_linkage_rms_Wb == pytest.approx(1e-3 * np.sqrt(np.mean(disk.rows.current**2)), rel=0.05)


def test_a_laws_constant_inductance_comes_from_the_flux_linkage():
    # Truth of the law's own form: its flux linkage is that of reciprocity plus 16 mH i plus 1 mWb
    table = force_table(lambda d, i: 6e-9 * d**-4 + 4.5e-6 * i * d**-2, actuator=ACTUATOR)
    rows = table.rows
    rows["flux_linkage_Wb"] = 4.5e-6 / rows["distance_m"] + 16e-3 * rows["current_A"] + 1e-3
    magnetics = fit_model(table, law="F1e").model.magnetics
    assert isinstance(magnetics, LawMagnetics)
    assert magnetics.constant_inductance_H == pytest.approx(16e-3, rel=1e-6)
    assert magnetics.reference_distance_m == 0.045  # the farthest of the sweep
    assert magnetics.constant_flux_linkage_Wb == pytest.approx(1e-3 + 4.5e-6 / 0.045, rel=1e-5)


@pytest.mark.parametrize("law", ["shifted-powers", "shifted-multipoles", "shifted-F1e", "exponential-harmonics"])
def test_a_laws_circuit_has_no_constants_that_cancel(ranked, law):
    # Counted from infinity, 2 mH were written as 162 H, and -165 Wb cancelled an inductance of 8 H
    candidate = next(c for c in ranked.ranking.candidates if c.law.name == law)
    magnetics = candidate.fit.magnetics()
    assert 1e-4 < magnetics.constant_inductance_H < 2e-3
    assert abs(magnetics.constant_flux_linkage_Wb) < 0.1
    assert candidate.misfit.flux_linkage_share < 0.02
    inductance = flat(magnetics).inductance(ranked.rows.distance, ranked.rows.current)
    assert 0.0 < inductance.min() < inductance.max() < 4e-3


def test_the_law_that_is_written_is_the_one_that_was_ranked(ranked, tmp_path):
    write_model(ranked.model, tmp_path / "m.json")
    assert misfit_to_rows(read_model(tmp_path / "m.json"), ranked.rows) == ranked.misfit
    best = ranked.ranking.recommended
    assert ranked.misfit.force_rms_N == pytest.approx(best.misfit.force_rms_N, rel=1e-9)
    assert ranked.model.magnetics.law_name == best.law.name
    facts = json.loads(json.dumps(ranked.to_dict(), allow_nan=False))["ranking"]
    assert facts["recommended"] == best.law.name
    lines = str(ranked).splitlines()
    assert len(lines) < 30
    heads = next(k for k, line in enumerate(lines) if line.split()[:3] == ["law", "ranked", "by"])
    cells = [line.split() for line in lines[heads + 1 :] if "not fitted" not in line]
    assert [row[0] for row in cells] == [c["law"] for c in facts["candidates"] if c["rms"] is not None]
    assert all(float(row[1]) == max(float(row[2]), float(row[3])) for row in cells)


def test_a_coefficient_says_whether_the_table_determines_it(disk, tmp_path):
    result = fit_model(full_table(), law="inverse-powers")
    intervals = result.law.interval
    undetermined = np.sum((intervals[:, 0] < 0.0) & (intervals[:, 1] > 0.0))
    assert str(result).count("not determined by this table") == undetermined > 0
    write_model(disk.model, tmp_path / "model.json")
    again = read_model(tmp_path / "model.json")
    np.testing.assert_array_equal(again.covariance, disk.model.covariance)
    coefficient = again.magnetics.coefficients[0]
    assert coefficient.ci95[0] < coefficient.value < coefficient.ci95[1]
    assert coefficient.unit == "N m^4"


# Several circuits


def test_circuits_domain_and_sensors_of_several_are_those_of_the_drawing():
    laser = {"kind": "position", "name": "gap", "noise": 1e-6, "distances_m": [0, 1], "readings": [0, 1], "unit": "m"}
    shunt = {"kind": "current", "name": "shunt", "noise": 1e-3, "circuit": "upper"}
    amplifier = {"kind": "current", "current_min_A": -1.0, "current_max_A": 2.0, "bandwidth_Hz": 500.0}
    upper = {"name": "upper", "resistance_ohm": 1.2, "drive": amplifier}
    entry = {**ENTRY, "circuits": [CIRCUITS[0], upper], "sensors": [laser, shunt]}
    behind = {"voltage_min_V": -12.0, "voltage_max_V": 48.0}
    model = fit_model(table_of(entry={**entry, "circuits": [CIRCUITS[0], upper | behind]})).model
    assert [(sensor.name, getattr(sensor, "circuit", None)) for sensor in model.other_sensors] == [
        ("gap", None), ("shunt", "upper"),
    ]  # fmt: skip
    upper = model.circuits[1]
    assert (upper.voltage_min_V, upper.voltage_max_V) == (-12.0, 48.0)
    assert (upper.drive.kind, upper.drive.current_max_A, upper.drive.bandwidth_Hz) == ("current", 2.0, 500.0)
    unknown = fit_model(table_of(entry=entry))
    assert unknown.model.circuits == ()
    assert "upper" in unknown.notes[0]
    early = {"name": "upper", "resistance_ohm": 1.2, "drive": {"kind": "current", "minimum": -1.0, "maximum": 2.0}}
    with pytest.raises(TableError, match="Sweep again"):
        fit_model(table_of(entry={**entry, "circuits": [CIRCUITS[0], early]}))
    fit = fit_of("bearing")
    assert [circuit.name for circuit in fit.model.circuits] == list(NAMES)
    assert fit.model.circuits[1].drive.diode_V == 0.7
    np.testing.assert_allclose(fit_of("bearing from one side").model.validity.current_limits_A, [[-2.0, 2.0]] * 2)
    assert "lower -2 to 2 A" in str(fit)
    few = fit_model(table_of(distances=np.linspace(0.4e-3, 0.6e-3, 5), currents=(-2.0, 2.0)))
    assert all("with a whole distance left out it misses" in str(one) for one in (few, fit))


def test_a_model_of_several_takes_currents_of_each_and_refuses_what_needs_one():
    model, d = fit_of("bearing").model, np.linspace(0.3e-3, 0.7e-3, 4)
    assert model.force(d, [0.5, -0.5]).shape == (4,)
    assert model.flux_linkage(d[:, None], np.zeros((4, 3, 2))).shape == (4, 3, 2)
    assert model.inductance(0.5e-3, [0.0, 0.0]).shape == (2, 2)
    for current, words in (([0.0, 3.0], r"-2\.\.2 A, -2\.\.2 A.*3 A"), (1.0, r"shape \(\.\.\., 2\)")):
        with pytest.raises(DomainError, match=words):
            model.force(0.5e-3, current)
    with pytest.raises(MissingPartError, match="lower, upper"):
        model.require_circuit()


@pytest.mark.nightly
def test_signs_that_were_not_swept_together_are_outside():
    fit, every = steel_fit(ONE_SIDE, ONE_SIDE), steel_fit(ONE_SIDE, BOTH_SIDES).model.validity
    assert fit.model.force(0.5e-3, [-1.0, -2.0]) == pytest.approx(fit.model.force(0.5e-3, [1.0, 2.0]), abs=1e-9)
    with pytest.raises(DomainError, match="reversed"):
        fit.model.force(0.5e-3, [1.0, -1.0])
    assert fit.model.validity.mirrored
    assert not any("too coarse" in note for note in fit.notes)
    np.testing.assert_array_equal(every.current_limits_A, [[-3.0, 3.0], [-3.0, 3.0]])
    assert not every.mirrored
    one_sided = fit_model(Saturating().table(currents=(0.0, 0.5, 1.0, 1.5, 2.0)))
    assert one_sided.model.validity.current_limits_A.min() == 0.0


def test_a_circuit_beyond_its_currents_keeps_its_inductance_as_far_as_it_is_positive():
    model, d = fit_of("two circuits that saturate").model, np.linspace(0.25e-3, 0.75e-3, 7)
    at_the_end = flat(model.magnetics).inductance(d, np.array([2.0, 0.7]))[:, 0, 0]
    assert at_the_end.min() > 0.0
    np.testing.assert_allclose(
        flat(model.magnetics).inductance(d, np.array([9.0, 0.7]))[:, 0, 0], at_the_end, rtol=1e-9
    )

    def motion(volts):
        command = dict.fromkeys(NAMES, volts)
        return simulate(model, voltage_V=command, start_m=0.5e-3, duration_s=2e-3, outside="extrapolate")

    assert motion(3.5).end_s == 2e-3
    with pytest.raises(SimulationError, match="Keep it within the validity domain"):
        motion(24.0)


def test_a_bound_of_ones_own_holds_a_coefficient():
    options = {"functions": ("constant", "through-origin"), "bounds": {"d^-2": (0.0, 1.4e-5)}}
    first, second = fit_model(full_table(), law="F1e", **options).model.magnetics.coefficients
    # m i <= 1.4e-5 up to 1.4 A is m <= 1e-5
    assert second.value == second.bounds[1] == pytest.approx(1e-5)
    assert (second.active, second.ci95, second.unit) == ("upper", None, "N m^2 A^-1")
    assert first.active == ""
    assert first.ci95[0] < first.value < first.ci95[1]
