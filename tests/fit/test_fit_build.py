"""From a table to a model: parts, misfits, notes, and every refusal."""

import json
import re
from dataclasses import asdict, replace

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import FitError, TableError, UsageError
from femfit.device.electrics import Drive
from femfit.device.mechanics import Mechanics, Spring, Stop
from femfit.fit.build import fit_model
from femfit.fit.law_fit import law_magnetics
from femfit.fit.misfit import as_written, misfit_to_rows
from femfit.model.json_file import read_model, write_model
from femfit.model.magnetics import CoenergySpline, LawMagnetics
from femfit.model.model_text import misfit_lines
from femfit.model.validity import Misfit
from femfit.tables.sweep_table import SweepTable
from support.sweeps import ACTUATOR, MASS, ClosedForm, force_table, full_table, grid

WEIGHT = MASS * 9.80665


@pytest.fixture(scope="module")
def table():
    return full_table()


@pytest.fixture(scope="module")
def coenergy(closed_form_fit):
    return closed_form_fit


@pytest.fixture(scope="module")
def disk(table):
    return fit_model(table, law="dipole-disk")


def test_a_full_table_gives_a_complete_model(coenergy):
    model = coenergy.model
    assert isinstance(model.magnetics, CoenergySpline)
    assert model.name == "test-rig"
    assert model.require_circuit().resistance_ohm == 2.69
    assert model.require_motion().mass_kg == MASS
    assert model.require_sensor().adc_bits == 12
    assert model.reference_distances_m == (0.022, 0.03)
    assert (model.validity.distance_min_m, model.validity.distance_max_m) == (0.015, 0.045)
    assert coenergy.notes == ()


def test_a_coenergy_that_the_sweep_does_not_determine_says_so():
    # Beyond a knee the force grows no further: six currents cannot tell where the knee stands
    def force(d, i):
        return 2e-3 / d * np.minimum(i / 0.5, 2e-2 / d) ** 2

    fit = fit_model(force_table(force, actuator=ACTUATOR, currents=np.linspace(0.0, 3.0, 6)), inductance_H=0.01)
    assert fit.model.misfit.force_rms_relative > 0.01
    assert any("too coarse" in note for note in fit.notes)


def test_what_the_import_warned_of_is_passed_on():
    findings = [
        {"code": "assumed-units", "severity": "info", "sentence": "SI assumed: I in A.", "remedy": "Name it."},
        {"code": "reciprocity", "severity": "warning", "sentence": "current in mA read as A (accepted)", "remedy": ""},
        {"code": "noise", "severity": "info", "sentence": "The force is smooth.", "remedy": ""},
    ]
    imported = full_table()
    fit = fit_model(SweepTable(imported.rows, {"actuator": ACTUATOR, "findings": findings}))
    assert fit.of_data == ("SI assumed: I in A. Name it.", "current in mA read as A (accepted)")
    assert all(f"note: {sentence}" in str(fit) for sentence in fit.of_data)
    assert fit.to_dict()["notes"] == list(fit.of_data)
    assert "smooth" not in str(fit)


def test_the_mechanics_and_the_drive_of_the_drawing_are_the_models():
    mechanics = Mechanics(MASS, 0.0, springs=(Spring(200.0, 0.8, 4e-3),), coulomb_N=0.05, far_stop=Stop(4e-3, 0.2))
    drive = {"kind": "voltage", "minimum": 0.0, "maximum": 12.0, "diode_V": 0.7, "bandwidth_Hz": None}
    entry = ACTUATOR | {"mechanics": asdict(mechanics), "circuits": [{"drive": drive}]}
    model = fit_model(SweepTable(full_table().rows, {"actuator": json.loads(json.dumps(entry))})).model
    assert model.motion == mechanics
    assert model.circuit.drive == Drive(diode_V=0.7)
    amplifier = drive | {"kind": "current", "minimum": -1.0, "maximum": 2.0, "diode_V": None, "bandwidth_Hz": 500.0}
    other = fit_model(full_table(), actuator=entry | {"circuits": [{"drive": amplifier}]}).model
    assert other.circuit.drive == Drive("current", None, -1.0, 2.0, 500.0)


def test_a_damaged_entry_of_the_mechanics_is_refused_by_its_key():
    entry = ACTUATOR | {"mechanics": {"coulomb_N": "much"}}
    with pytest.raises(TableError, match="coulomb_N"):
        fit_model(SweepTable(full_table().rows, {"actuator": entry}))


def test_the_coenergy_is_within_a_tenth_of_a_percent_of_its_sweep(coenergy):
    misfit = coenergy.model.misfit
    assert misfit.against == "sweep"
    assert misfit.rows == 488
    assert misfit.force_rms_relative < 1e-3
    assert misfit.force_rms_of_weight < 1e-3
    assert misfit.force_max_N >= misfit.force_rms_N


def voice_coil():
    """A coil in a gap: currents of both signs, a motional constant with a hump, 2 mH that saturate a little."""
    bent = ClosedForm(saturation=6.0)

    # Off the centre of the magnet's field the coil is driven less; its inductance falls with the distance
    def motional_flux(d):
        return -5.6 * d + 2.2e4 * (d - 9e-3) ** 3 / 3.0

    def motional(d):
        return 5.6 - 2.2e4 * (d - 9e-3) ** 2

    i, d = grid(np.linspace(-4.0, 4.0, 9), np.linspace(4e-3, 14e-3, 11))
    force = motional(d) * i + 1e-3 / 6e-3 * np.exp(-d / 6e-3) * bent._g(i, 0)
    flux = motional_flux(d) + (1e-3 + 1e-3 * np.exp(-d / 6e-3)) * bent._g(i, 1)
    rows = pd.DataFrame({"current_A": i, "distance_m": d, "force_N": force, "flux_linkage_Wb": flux, "status": "ok"})
    return SweepTable(rows, {"name": "voice-coil", "actuator": {"name": "voice-coil", "mass_kg": 0.012}})


@pytest.fixture(scope="module")
def ranked_voice_coil():
    return fit_model(voice_coil(), law="all")


def test_the_motional_constant_is_stated_over_the_whole_domain_and_not_at_the_swept_points_alone():
    def force(d, i):
        return 1.5e-3 / d * i / (1.0 + (i / 1.5) ** 2)  # rises most steeply at 0 A, between two currents

    fit = fit_model(force_table(force, currents=np.linspace(-4.0, 4.0, 8)))
    d = np.linspace(0.015, 0.045, 301)
    at_rest = fit.model.magnetics.motional_constant(d, np.zeros_like(d)).max()
    assert at_rest > 1.1 * fit.model.magnetics.motional_constant(fit.rows.distance, fit.rows.current).max()
    found = re.search(r"motional constant dF/di \S+ to (\S+) N/A", str(fit))
    assert float(found[1]) == pytest.approx(at_rest, rel=1e-3)


def test_the_law_that_is_written_is_the_one_that_was_ranked(ranked_voice_coil, tmp_path):
    result = ranked_voice_coil
    write_model(result.model, tmp_path / "m.json")
    read_back = misfit_to_rows(read_model(tmp_path / "m.json"), result.rows)
    assert read_back == result.misfit
    assert result.misfit.force_rms_N == pytest.approx(result.ranking.recommended.misfit.force_rms_N, rel=1e-9)
    scale, _ = result.rows.error_scale
    assert result.misfit.force_rms_N <= 1.1 * scale * result.ranking.recommended.rms


@pytest.mark.parametrize("law", ["shifted-powers", "shifted-multipoles", "shifted-F1e", "exponential-harmonics"])
def test_a_laws_circuit_has_no_constants_that_cancel(ranked_voice_coil, law):
    # Counted from infinity, 2 mH were written as 162 H, and -165 Wb cancelled an inductance of 8 H
    candidate = next(c for c in ranked_voice_coil.ranking.candidates if c.law.name == law)
    magnetics = law_magnetics(candidate.fit, ranked_voice_coil.rows)
    assert 1e-4 < magnetics.constant_inductance_H < 2e-3
    assert abs(magnetics.constant_flux_linkage_Wb) < 0.1
    assert candidate.misfit.flux_linkage_share < 0.02
    inductance = magnetics.inductance(ranked_voice_coil.rows.distance, ranked_voice_coil.rows.current)
    assert 0.0 < inductance.min() < inductance.max() < 4e-3


def test_a_misfit_counts_force_flux_linkage_and_inductance(disk):
    off = replace(disk.model.magnetics, constant_inductance_H=disk.model.magnetics.constant_inductance_H + 1e-3)
    misfit = misfit_to_rows(as_written(replace(disk.model, magnetics=off)), disk.rows)
    assert misfit.force_rms_N == disk.misfit.force_rms_N
    assert misfit.inductance_rms_H == pytest.approx(1e-3, rel=0.05)
    # 1 mH times the rms of 0 to 1.4 A
    assert misfit.flux_linkage_rms_Wb == pytest.approx(1e-3 * np.sqrt(np.mean(disk.rows.current**2)), rel=0.05)


def test_a_model_that_its_file_changes_is_not_written(table, monkeypatch):
    def rounded(model):
        wrong = [replace(c, value=0.5 * c.value) for c in model.magnetics.coefficients]
        return replace(model, magnetics=replace(model.magnetics, coefficients=tuple(wrong)))

    monkeypatch.setattr("femfit.fit.build.as_written", rounded)
    with pytest.raises(FitError, match="F1e is not written"):
        fit_model(table, law="F1e")


def test_a_model_whose_file_changes_its_inductance_alone_is_not_written(table, monkeypatch):
    def longer(model):
        more = model.magnetics.constant_inductance_H + 1e-3
        return replace(model, magnetics=replace(model.magnetics, constant_inductance_H=more))

    monkeypatch.setattr("femfit.fit.build.as_written", longer)
    with pytest.raises(FitError, match="misses the table's flux linkage"):
        fit_model(table, law="F1e")


def test_a_sweep_without_current_is_told_to_have_some():
    table = voice_coil()
    table.rows["flux_linkage_Wb"] = 3e-3 * table.rows["distance_m"] / table.rows["distance_m"].max()
    still = replace(table, rows=table.rows[table.rows["current_A"] == 0.0].reset_index(drop=True))
    (note,) = (note for note in fit_model(still).notes if "do not simulate its circuit" in note)
    assert note.endswith("Give [sweep] more than one current, then sweep and fit again.")


def test_a_circuit_that_a_law_does_not_hold_is_said():
    table = voice_coil()
    table.rows["flux_linkage_Wb"] = 3e-3 * np.tanh(table.rows["current_A"])
    result = fit_model(table, law="shifted-multipoles")
    (note,) = (note for note in result.notes if "do not simulate its circuit" in note)
    assert "without --model" in note


def test_a_coenergy_that_misses_the_flux_linkage_asks_for_finer_currents_and_not_for_itself():
    table = voice_coil()
    table.rows["flux_linkage_Wb"] = 3e-3 * np.tanh(30.0 * table.rows["current_A"])
    (note,) = (note for note in fit_model(table).notes if "do not simulate its circuit" in note)
    assert "without --model" not in note
    assert "currents" in note


def test_a_laws_constant_inductance_comes_from_the_flux_linkage():
    # Truth of the law's own form: its flux linkage is that of reciprocity plus 16 mH i plus 1 mWb.
    def force(d, i):
        return 6e-9 * d**-4 + 4.5e-6 * i * d**-2

    table = force_table(force, actuator=ACTUATOR)
    rows = table.rows
    rows["flux_linkage_Wb"] = 4.5e-6 / rows["distance_m"] + 16e-3 * rows["current_A"] + 1e-3
    magnetics = fit_model(table, law="F1e").model.magnetics
    assert isinstance(magnetics, LawMagnetics)
    assert magnetics.constant_inductance_H == pytest.approx(16e-3, rel=1e-6)
    # At the farthest distance of the sweep, 45 mm
    assert magnetics.reference_distance_m == 0.045
    assert magnetics.constant_flux_linkage_Wb == pytest.approx(1e-3 + 4.5e-6 / 0.045, rel=1e-5)


def test_the_model_survives_its_file(disk, tmp_path):
    path = tmp_path / "model.json"
    write_model(disk.model, path)
    again = read_model(path)
    d, i = np.meshgrid([0.02, 0.03], [0.1, 0.9])
    np.testing.assert_array_equal(again.magnetics.force(d, i), disk.model.magnetics.force(d, i))
    np.testing.assert_array_equal(again.covariance, disk.model.covariance)
    coefficient = again.magnetics.coefficients[0]
    assert coefficient.ci95[0] < coefficient.value < coefficient.ci95[1]
    assert coefficient.unit == "N m^4"


def test_an_active_bound_is_marked_in_the_model_and_has_no_interval(table):
    fit = fit_model(table, law="F1e", functions=("constant", "through-origin"), bounds={"d^-2": (0.0, 1.4e-5)})
    first, second = fit.model.magnetics.coefficients
    # m i <= 1.4e-5 up to 1.4 A is m <= 1e-5.
    assert second.value == second.bounds[1] == pytest.approx(1e-5)
    assert (second.active, second.ci95, second.unit) == ("upper", None, "N m^2 A^-1")
    assert first.active == ""
    assert first.ci95[0] < first.value < first.ci95[1]


def test_all_writes_the_recommended_law(ranked_voice_coil):
    result = ranked_voice_coil
    assert result.model.magnetics.law_name == result.ranking.recommended.law.name
    ranking = json.loads(json.dumps(result.to_dict(), allow_nan=False))["ranking"]
    assert len(ranking["candidates"]) >= 8
    assert ranking["recommended"] == result.model.magnetics.law_name
    assert all(c["law"] in str(result) for c in ranking["candidates"])
    assert len(str(result).splitlines()) < 30


def test_the_ranking_is_printed_in_its_own_order_and_in_one_unit(ranked_voice_coil):
    ranking = ranked_voice_coil.ranking
    lines = ranking.lines()
    heads = next(line for line in lines if "ranked by" in line and "operations" in line)
    assert heads.split()[:7] == ["law", "ranked", "by", "left", "out", "all", "points"]
    table = [line.split() for line in lines[lines.index(heads) + 1 :] if "not fitted" not in line]
    errors = [float(cells[1]) for cells in table]
    assert errors == sorted(errors)
    assert all(
        ranked == max(left_out, written) for ranked, left_out, written in ((float(c) for c in r[1:4]) for r in table)
    )


def test_a_coefficient_whose_interval_holds_zero_is_not_printed_as_a_number(table):
    result = fit_model(table, law="inverse-powers")
    intervals = result.law.interval.block
    undetermined = np.sum((intervals[:, 0] < 0.0) & (intervals[:, 1] > 0.0))
    assert undetermined > 0
    assert str(result).count("not determined by this table") == undetermined


@pytest.mark.parametrize(
    ("length", "series_H", "period"), [(1.0, 0.0, 5e-4), (10.0, 0.0, 5e-3), (0.01, 0.0, 5e-6), (0.01, 0.05, 2e-5)]
)
def test_a_period_that_no_file_gives_follows_from_the_coil_and_the_body(length, series_H, period):
    # L/R is 16 mH / 2.69 ohm = 6 ms, ten times as much, a hundredth, and with 50 mH in series four times that
    actuator = {key: value for key, value in ACTUATOR.items() if key != "sample_time_s"}
    actuator |= {"resistance_ohm": 2.69 / length, "mass_kg": MASS * max(1.0, length) ** 2}
    actuator |= {"circuits": [{"name": "coil", "inductance_H": series_H}]}
    assert fit_model(full_table(actuator=actuator)).model.sample_time_s == pytest.approx(period)


def test_a_table_without_an_actuator_says_what_to_give():
    result = fit_model(full_table(actuator=None))
    assert result.model.circuit is None
    assert result.model.motion is None
    assert result.model.sensor is None
    assert result.model.misfit.force_rms_of_weight is None
    assert any("resistance_ohm, voltage_min_V, voltage_max_V unknown. Give --actuator" in n for n in result.notes)
    assert any("--mass-g" in note for note in result.notes)


def test_options_replace_single_values_of_the_manifest(table):
    result = fit_model(table, law="F2e", mass_kg=8e-3, resistance_ohm=5.0, supply_V=(-6.0, 6.0))
    assert result.model.motion.mass_kg == 8e-3
    assert result.model.circuit.resistance_ohm == 5.0
    assert result.model.circuit.voltage_min_V == -6.0


def test_force_alone_needs_a_declared_inductance_for_a_circuit():
    alone = force_table(ClosedForm().force, actuator=ACTUATOR)
    without = fit_model(alone)
    assert without.model.circuit is None
    assert any("--inductance-H since the table has no flux linkage" in note for note in without.notes)
    given = fit_model(alone, inductance_H=16e-3)
    assert given.model.circuit is not None
    assert given.model.magnetics.inductance(np.array(0.045), np.array(0.5)) == pytest.approx(16e-3, rel=1e-9)
    law = fit_model(alone, law="F1e", inductance_H=16e-3).model.magnetics
    assert law.constant_inductance_H == 16e-3


def test_a_table_too_small_for_a_coenergy_still_gives_a_law():
    small = full_table(distances=np.linspace(0.015, 0.045, 4), currents=[0.0, 0.7, 1.4])
    result = fit_model(small, law="F1e")
    assert result.coenergy is None
    assert result.misfit.against == "sweep"


def broken(change):
    table = full_table()
    return SweepTable(change(table.rows), table.manifest)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r.iloc[:0], "none among its 0"),
        (lambda r: r.iloc[:9], "at least 12 usable rows at 4 distances; instead received 9 rows at 2"),
        (lambda r: r.assign(force_N=r["force_N"].where(r.index != 7)), "force_N must hold finite numbers.*row 8"),
        (lambda r: r.assign(force_N="1,5"), "force_N must be numeric"),
        (lambda r: r.assign(force_N=np.inf), "finite numbers"),
        (lambda r: r.assign(flux_linkage_Wb=r["flux_linkage_Wb"].where(r.index > 3)), "flux_linkage_Wb must hold"),
        (lambda r: r.drop(columns="force_N"), "force_N missing"),
        (lambda r: r.assign(distance_m=1e3 * r["distance_m"]), "distance_m seems to be in mm"),
        (lambda r: r.iloc[[*range(len(r)), 0]], "1 repeat another, the first at 0 A and 15 mm"),
        (lambda r: r.assign(status="failed"), "none among its 488"),
    ],
)
def test_unusable_tables_are_refused_with_place_and_remedy(change, message):
    with pytest.raises(TableError, match=message):
        fit_model(broken(change))


@pytest.mark.parametrize(
    "actuator",
    [{"mass_kg": "4 g"}, {"resistance_ohm": [2]}, {"sample_time_s": "soon"}, {"hall": 5}, {"kind": {"a": True}}],
)
def test_a_damaged_manifest_is_one_clear_error(table, actuator):
    with pytest.raises(TableError, match="manifest must give"):
        fit_model(SweepTable(table.rows, {"actuator": {**ACTUATOR, **actuator}}), law="F2e")


@pytest.mark.parametrize("text", ["[]", '{"actuator": 5}', "[" * 5000])
def test_a_manifest_that_is_none_is_one_clear_error(tmp_path, text):
    full_table().rows.to_csv(tmp_path / "sweep.csv", index=False)
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(TableError, match=r"manifest\.json"):
        fit_model(tmp_path)


@pytest.mark.parametrize("law", ["F1e", "all", None])
def test_one_current_is_refused_by_every_model_with_what_to_do(law):
    with pytest.raises(FitError, match=r"at least 3 currents.*Sweep"):
        fit_model(full_table(currents=[0.2]), law=law)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"law": "F9"}, "must be coenergy, all or a law .*F1e.*; instead received 'F9'"),
        ({"bounds": {"d^-4": (0.0, 1.0)}}, "bounds can be given for one law only; instead received model 'coenergy'"),
        ({"law": "all", "functions": ("affine",)}, "functions can be given for one law only"),
        ({"mass_kg": -1.0}, "mass_kg must be > 0"),
        ({"inductance_H": float("nan")}, "inductance_H must be > 0"),
    ],
)
def test_options_that_mean_nothing_are_refused(table, options, message):
    with pytest.raises(UsageError, match=message):
        fit_model(table, **options)


def test_functions_must_be_known_and_one_a_column(table):
    with pytest.raises(
        UsageError, match="one of constant, through-origin, square, affine, quadratic for each of 2 columns"
    ):
        fit_model(table, law="F1e", functions=("constant",))
    with pytest.raises(UsageError, match="one of constant"):
        fit_model(table, law="F1e", functions=("constant", "cubic"))


@pytest.mark.parametrize(
    ("newtons", "words"),
    [
        (2.706e-6, "2.71 µN rms"),
        (0.0125, "12.5 mN rms"),
        (2.99, "2.99 N rms"),
        (3659.0, "3.66 kN rms"),
        (0.0, "0 N rms"),
    ],
)
def test_forces_are_printed_in_the_unit_of_their_size(newtons, words):
    (line,) = misfit_lines(Misfit(newtons, newtons, 1e-3, None, None, None, 36, "sweep"))
    assert words in line
    assert "weight" not in line
