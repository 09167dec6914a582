"""From a table to a model: parts, misfits, notes, and every refusal."""

import json

import numpy as np
import pytest

from femfit.core.errors import FitError, TableError
from femfit.fit.build import FitOptions, fit_model
from femfit.fit.text import fit_lines, misfit_line
from femfit.model.actuator_model import Misfit
from femfit.model.json_file import read_model, write_model
from femfit.model.magnetics import CoenergySpline, LawMagnetics
from femfit.tables.sweep_table import SweepTable
from support.sweeps import ACTUATOR, MASS, ClosedForm, force_table, full_table

WEIGHT = MASS * 9.80665


@pytest.fixture(scope="module")
def table():
    return full_table()


@pytest.fixture(scope="module")
def coenergy(table):
    return fit_model(table)


@pytest.fixture(scope="module")
def disk(table):
    return fit_model(table, FitOptions(model="dipole-disk"))


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

    fit = fit_model(
        force_table(force, actuator=ACTUATOR, currents=np.linspace(0.0, 3.0, 6)), FitOptions(inductance_H=0.01)
    )
    assert fit.model.misfit.force_rms_relative > 0.01
    assert any("sweep more" in note for note in fit.notes)


def test_what_the_import_warned_of_comes_first():
    findings = [
        {"code": "assumed-units", "severity": "info", "sentence": "SI assumed: I in A.", "remedy": "Name it."},
        {"code": "reciprocity", "severity": "warning", "sentence": "current in mA read as A (accepted)", "remedy": ""},
        {"code": "noise", "severity": "info", "sentence": "The force is smooth.", "remedy": ""},
    ]
    imported = full_table()
    fit = fit_model(SweepTable(imported.rows, {"actuator": ACTUATOR, "findings": findings}))
    assert fit.of_data == ("SI assumed: I in A. Name it.", "current in mA read as A (accepted)")
    assert fit_lines(fit)[:2] == [f"note: {sentence}" for sentence in fit.of_data]
    assert fit.data["notes"] == list(fit.of_data)
    assert not any("smooth" in line for line in fit_lines(fit))


def test_the_coenergy_is_within_a_tenth_of_a_percent_of_its_sweep(coenergy):
    misfit = coenergy.model.misfit
    assert misfit.against == "sweep"
    assert misfit.rows == 488
    assert misfit.force_rms_relative < 1e-3
    assert misfit.force_rms_of_weight < 1e-3
    assert misfit.force_max_N >= misfit.force_rms_N


def test_a_law_stores_its_misfit_against_sweep_and_reference(disk):
    assert [m.against for m in disk.misfits] == ["sweep", "co-energy reference"]
    assert disk.model.misfit is disk.misfits[0]
    stored = disk.model.provenance["fit"]["misfits"]
    assert [m["against"] for m in stored] == ["sweep", "co-energy reference"]
    # The reference is much closer to the sweep than the law: both misfits agree to its own error.
    assert stored[0]["force_rms_N"] == pytest.approx(stored[1]["force_rms_N"], rel=0.01)


def test_a_laws_constant_inductance_comes_from_the_flux_linkage():
    # Truth of the law's own form: its flux linkage is that of reciprocity plus 16 mH i plus 1 mWb.
    def force(d, i):
        return 6e-9 * d**-4 + 4.5e-6 * i * d**-2

    table = force_table(force, actuator=ACTUATOR)
    rows = table.rows
    rows["flux_linkage_Wb"] = 4.5e-6 / rows["distance_m"] + 16e-3 * rows["current_A"] + 1e-3
    magnetics = fit_model(table, FitOptions(model="F1e")).model.magnetics
    assert isinstance(magnetics, LawMagnetics)
    assert magnetics.constant_inductance_H == pytest.approx(16e-3, rel=1e-6)
    assert magnetics.constant_flux_linkage_Wb == pytest.approx(1e-3, rel=1e-5)


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
    options = FitOptions(
        model="F1e",
        functions=("constant", "through-origin"),
        coefficient_bounds={"d^-2": (0.0, 1.4e-5)},
        stages="joint",
    )
    first, second = fit_model(table, options).model.magnetics.coefficients
    # m i <= 1.4e-5 up to 1.4 A is m <= 1e-5.
    assert second.value == second.bounds[1] == pytest.approx(1e-5)
    assert (second.active, second.ci95, second.unit) == ("upper", None, "N m^2 A^-1")
    assert first.active == ""
    assert first.ci95[0] < first.value < first.ci95[1]


def test_all_writes_the_recommended_law(table):
    result = fit_model(table, FitOptions(model="all"))
    assert result.model.magnetics.law_name == result.ranking.recommended.law.name
    ranking = result.data["ranking"]
    assert len(ranking["candidates"]) >= 8
    assert ranking["recommended"] == result.model.magnetics.law_name
    text = "\n".join(fit_lines(result))
    assert all(c["law"] in text for c in ranking["candidates"])
    assert "recommended: " in text


def test_report_data_are_json_and_the_text_names_what_they_hold(disk):
    data = json.loads(json.dumps(disk.data, allow_nan=False))
    assert {"model", "misfits", "law", "coenergy", "hall", "linearity"} <= set(data)
    text = "\n".join(fit_lines(disk))
    for words in (
        "stage one",
        "stage two",
        "J_3",
        "95 %",
        "condition number",
        "N m^4",
        "% of the weight",
        "Hall field",
        "linearity",
        "constant inductance",
        "V/A",
    ):
        assert words in text


def test_a_table_without_an_actuator_says_what_to_give():
    result = fit_model(full_table(actuator=None))
    assert result.model.circuit is None
    assert result.model.motion is None
    assert result.model.sensor is None
    assert result.model.misfit.force_rms_of_weight is None
    assert any("resistance_ohm, voltage_min_V, voltage_max_V unknown. Give --actuator" in n for n in result.notes)
    assert any("--mass-g" in note for note in result.notes)


def test_options_replace_single_values_of_the_manifest(table):
    result = fit_model(table, FitOptions(model="F2e", mass_kg=8e-3, resistance_ohm=5.0))
    assert result.model.motion.mass_kg == 8e-3
    assert result.model.circuit.resistance_ohm == 5.0


def test_force_alone_needs_a_declared_inductance_for_a_circuit():
    alone = force_table(ClosedForm().force, actuator=ACTUATOR)
    without = fit_model(alone)
    assert without.model.circuit is None
    assert any("--inductance-H since the table has no flux linkage" in note for note in without.notes)
    given = fit_model(alone, FitOptions(inductance_H=16e-3))
    assert given.model.circuit is not None
    assert given.model.magnetics.inductance(np.array(0.045), np.array(0.5)) == pytest.approx(16e-3, rel=1e-9)
    law = fit_model(alone, FitOptions(model="F1e", inductance_H=16e-3)).model.magnetics
    assert law.constant_inductance_H == 16e-3


def test_a_table_too_small_for_a_coenergy_still_gives_a_law():
    small = full_table(distances=np.linspace(0.015, 0.045, 4), currents=[0.0, 0.7, 1.4])
    result = fit_model(small, FitOptions(model="F1e"))
    assert result.coenergy is None
    assert [m.against for m in result.misfits] == ["sweep"]


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
        (lambda r: r.iloc[[*range(len(r)), 0]], "1 repeat another, the first at 0 A and 15 mm"),
        (lambda r: r.assign(status="failed"), "none among its 488"),
    ],
)
def test_unusable_tables_are_refused_with_place_and_remedy(change, message):
    with pytest.raises(TableError, match=message):
        fit_model(broken(change))


@pytest.mark.parametrize("model", ["F1e", "all", "coenergy"])
def test_one_current_is_refused_by_every_model_with_what_to_do(model):
    with pytest.raises(FitError, match=r"at least 3 currents.*Sweep"):
        fit_model(full_table(currents=[0.2]), FitOptions(model=model))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"model": "F9"}, "must be coenergy, all or a law .*F1e.*; instead received 'F9'"),
        ({"bounds": "paper"}, "bounds can be given for one law only; instead received model 'coenergy'"),
        ({"model": "all", "functions": ("affine",)}, "functions can be given for one law only"),
        ({"stages": "three"}, "'two' or 'joint'"),
        ({"mass_kg": -1.0}, "mass_kg must be > 0"),
        ({"inductance_H": float("nan")}, "inductance_H must be > 0"),
    ],
)
def test_options_that_mean_nothing_are_refused(options, message):
    with pytest.raises(FitError, match=message):
        FitOptions(**options)


def test_functions_must_be_known_and_one_a_column(table):
    with pytest.raises(
        FitError, match="one of constant, through-origin, square, affine, quadratic for each of 2 columns"
    ):
        fit_model(table, FitOptions(model="F1e", functions=("constant",)))
    with pytest.raises(FitError, match="one of constant"):
        fit_model(table, FitOptions(model="F1e", functions=("constant", "cubic")))


@pytest.mark.parametrize(
    ("newtons", "words"),
    [
        (2.706e-6, "2.706 uN rms"),
        (0.0125, "12.5 mN rms"),
        (2.99, "2.99 N rms"),
        (3659.0, "3.659 kN rms"),
        (0.0, "0 N rms"),
    ],
)
def test_forces_are_printed_in_the_unit_of_their_size(newtons, words):
    line = misfit_line(Misfit(newtons, newtons, 1e-3, None, None, None, 36, "sweep"))
    assert words in line
    assert "weight" not in line
