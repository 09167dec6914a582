"""Measured inductances, and sweeps of plungers that saturate: the force is the one that their slope makes."""

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest

from femfit import fit_model, read_actuator
from femfit.core.errors import FitError, ModelFileError, TableError, UsageError
from femfit.core.results import Finding
from femfit.fit import coenergy_choice, ranking
from femfit.fit.soft_iron import fit_inductance
from femfit.laws.catalogue import all_laws
from femfit.model.json_file import model_from_dict, model_to_dict, read_model
from femfit.model.several_magnetics import NetworkMagnetics
from femfit.tables.measurement import InductanceTable
from femfit.tables.measurement_file import is_inductance_table, read_inductance_table
from support.actuators import GEOMETRY
from support.command import femfit, worked
from support.one_current import flat
from support.plungers import DEVICES, network_of, plunger_table

D = np.linspace(1e-3, 20e-3, 14)
OPTIONS = {"mass_kg": 0.06, "resistance_ohm": 4.0, "supply_V": (0.0, 12.0)}


def inductance(distance):
    return 0.1 + 0.03 * np.exp(-distance / 3e-3) + 0.02 * np.exp(-distance / 12e-3)


def force(distance, current):
    """Half the squared current times the inductance's fall."""
    fall = 10.0 * np.exp(-distance / 3e-3) + 0.02 / 12e-3 * np.exp(-distance / 12e-3)
    return 0.5 * current**2 * fall


def table(noise_H=0.0):
    d, i = (part.ravel() for part in np.meshgrid(D, [0.5, 1.0, 2.0]))
    generator = np.random.default_rng(4)
    return InductanceTable(d, i, inductance(d) + noise_H * generator.standard_normal(len(d)))


def test_the_force_of_an_exact_table_is_found_without_any_force():
    fit, i = fit_inductance(table(), **OPTIONS), np.full_like(D, 1.5)
    # The search of the two lengths stops at 1e-8 of its cost
    np.testing.assert_allclose(flat(fit.model.magnetics).force(D, i), force(D, 1.5), rtol=1e-3)
    np.testing.assert_allclose(flat(fit.model.magnetics).flux_linkage(D, i), 1.5 * inductance(D), rtol=1e-5)
    assert fit.notes == ()
    assert fit.model.require_circuit().voltage_max_V == 12.0


def test_what_the_table_needed_and_what_a_law_misses_is_said():
    said = (Finding("column", "info", "current_mA was read as current_A."),)
    fit = fit_inductance(dataclasses.replace(table(), findings=said), **OPTIONS)
    assert "note: current_mA was read as current_A." in str(fit)
    assert fit.to_dict()["notes"] == ["current_mA was read as current_A."]
    step = np.where(table().distance < 8e-3, 0.15, 0.1)
    fit = fit_inductance(InductanceTable(table().distance, table().current, step), law="F2e")
    assert any("of the inductance's change" in note for note in fit.notes)


def test_noise_of_one_per_cent_never_makes_the_force_repel():
    fit = fit_inductance(table(1e-3), **OPTIONS)
    found = flat(fit.model.magnetics).force(D, np.ones_like(D))
    assert np.all(found > 0.0)
    # 42 rows of 1 mH tell a fall of 50 mH over 20 mm; its slope in the middle of the range to about 10 %
    middle = slice(4, 10)
    np.testing.assert_allclose(found[middle], force(D, 1.0)[middle], rtol=0.3)


def test_inductances_that_make_no_force_are_refused_with_the_cause():
    short = InductanceTable(D[:4], np.ones(4), inductance(D[:4]))
    with pytest.raises(FitError, match="needs as many distances"):
        fit_inductance(short, **OPTIONS)
    with pytest.raises(UsageError, match="lowest voltage must be below its highest"):
        fit_inductance(table(), **OPTIONS | {"supply_V": (12.0, 0.0)})
    rising = fit_inductance(InductanceTable(table().distance, table().current, 0.25 - table().inductance), **OPTIONS)
    assert any("inductances fall" in note for note in rising.notes)


def written_table(directory):
    rows = table()
    lines = [f"{1e3 * d},{i},{1e3 * h}" for d, i, h in zip(rows.distance, rows.current, rows.inductance, strict=True)]
    path = directory / "steps.csv"
    path.write_text("\n".join(["distance_mm,current_A,inductance_mH", *lines]) + "\n")
    return path


PLUNGER = GEOMETRY / "plunger-solenoid.toml"
DRAWN = read_actuator(PLUNGER)


@pytest.mark.parametrize(
    ("options", "ohm", "highest_V"),
    [
        (("--resistance-ohm", 4, "--supply-V", "0:12"), 4.0, 12.0),
        # Its mass is another than the one that is given
        (("--actuator", PLUNGER), DRAWN.coil.resistance_ohm, DRAWN.circuits[0].voltage_max_V),
    ],
    ids=["by options", "by an actuator file"],
)
def test_a_file_of_inductances_becomes_a_model_file(tmp_path, options, ohm, highest_V):
    path = written_table(tmp_path)
    assert is_inductance_table(path)
    worked("fit", path, "--model", "two-exponentials", "--mass-g", 60, *options, "-o", tmp_path / "model.json")
    model = read_model(tmp_path / "model.json")
    assert (model.circuit.resistance_ohm, model.circuit.voltage_max_V, model.motion.mass_kg) == (ohm, highest_V, 0.06)
    assert flat(model.magnetics).force(np.array([5e-3]), np.ones(1)) == pytest.approx(force(5e-3, 1.0), rel=1e-3)
    refused = femfit("fit", path)
    assert refused.returncode == 2
    assert "coenergy" in refused.stderr


def test_a_table_with_forces_is_no_table_of_inductances(tmp_path):
    path = tmp_path / "bench.csv"
    path.write_text("distance_mm,current_A,inductance_mH,force_N\n1,1,100,0.5\n")
    assert not is_inductance_table(path)
    path.write_text("distance_mm,inductance_mH\n1,100\n")
    with pytest.raises(TableError, match="lacks current_A"):
        read_inductance_table(path)


@pytest.fixture(params=DEVICES)
def fitted(request):
    return network_of(request.param)


def test_force_of_a_saturating_plunger_is_met_within_two_percent(fitted):
    rows, fit = fitted
    assert fit.fitted < 0.02
    table = rows.linked[:, 0]
    flux = flat(fit.magnetics).flux_linkage(rows.distance, rows.current) - table
    assert np.sqrt(np.mean(flux**2)) < 0.02 * np.sqrt(np.mean(table**2))


def test_the_model_keeps_the_law_and_says_its_misfit():
    fit = fit_model(plunger_table("pull"), law="reluctance-network")
    assert fit.misfit.force_share < 0.02
    assert "reluctance-network" in str(fit)
    again = model_from_dict(json.loads(json.dumps(model_to_dict(fit.model))))
    assert again.magnetics.log_reluctance == fit.model.magnetics.log_reluctance
    assert again.force(1e-3, 0.7) == fit.model.force(1e-3, 0.7)
    fit.model.require_dynamics()
    data = model_to_dict(fit.model)
    data["magnetics"]["leakage_H"] = [1.0]
    with pytest.raises(ModelFileError, match=r"magnetics\.leakage_H must be 2 numbers"):
        model_from_dict(data)


def test_all_takes_the_network_where_no_law_of_columns_is_good():
    fit = fit_model(plunger_table("pull"), law="all")
    assert fit.law is None
    assert isinstance(fit.model.magnetics, NetworkMagnetics)
    assert fit.to_dict()["model"] == "reluctance-network"


LITTLE_LESS = 1.0 - 1e-9
"""A solver's last step, and an order of summation, change as much."""


def test_the_first_of_equal_laws_is_ranked_first(monkeypatch):
    laws = list(all_laws().values())[:3]
    errors = dict(zip((law.name for law in laws), (1.0, LITTLE_LESS, 0.5), strict=True))

    def candidate(law, _rows, _folds):
        fit = SimpleNamespace(operations=7)
        return ranking.Candidate(law, fit, None, 0.01 * errors[law.name], 0.0, 2)

    monkeypatch.setattr(ranking, "_candidate", candidate)
    monkeypatch.setattr(ranking, "ranking_folds", lambda _: [])
    rows = SimpleNamespace(error_scale=(1.0, "N"), hanging_weight=1.0)
    ranked = ranking.rank_laws(laws, rows)
    assert [one.law.name for one in ranked.candidates] == [laws[2].name, laws[0].name, laws[1].name]


@pytest.mark.parametrize("errors", [
    [(1e-6, 1e-6), (LITTLE_LESS * 1e-6, 1e-6 * LITTLE_LESS)],  # good enough
    [(1.0, 10.0), (10.0 * LITTLE_LESS, 1.0)],  # each the worse in one quantity
])  # fmt: skip
def test_the_first_of_equal_bases_holds_the_coenergy(errors):
    chosen, _ = coenergy_choice.smallest([range(len(errors))], lambda number: np.array(errors[number]))
    assert chosen == 0
