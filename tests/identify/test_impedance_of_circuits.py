"""Measured impedances of two circuits: each alone, the two together, and one beside the other shorted."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import TableError
from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.identify.comparison.compare import compare
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.experiments.suggest import suggest
from femfit.identify.refit.add_effects import add_effects
from femfit.model.drawn_effect import DrawnEffect
from femfit.model.json_file import read_model, write_model
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of, with_effects
from femfit.tables.measurement_file import read_measurement
from support.conductivities import KEY, with_conductivity
from support.eddies import with_eddies
from support.halves import NAMES, halves_with_eddies
from support.impedances import FREQUENCIES

EACH, BOTH, SHORT = NAMES, ("inner_outer",), ("inner_outer_shorted",)
WANTED = ("inductance_H", "resistance_ohm")


@pytest.fixture(scope="module")
def whole(levitation_model):
    return replace(with_eddies(levitation_model), sensor=None)


@pytest.fixture(scope="module")
def model(whole):
    """Halves whose conductivity is a number of the drawing."""
    drawn = DrawnEffect(KEY, (), "the conductivity of core", 6.0, "", 0.1, (), conducts=True)
    return replace(halves_with_eddies(whole), drawn=(drawn,))


def impedances(model, d, i, f):
    """By the name in the column."""
    read = predict_readings(model, d, i, Conditions(nominal_of(model), frequency_Hz=f), channels=WANTED)
    names = [name.removeprefix("inductance").removesuffix("H").strip("_") for name in read if "inductance" in name]
    column = {name: f"_{name}_" if name else "_" for name in names}
    return {name: read[f"resistance{of}ohm"] + 2j * np.pi * f * read[f"inductance{of}H"] for name, of in column.items()}


def bench(model, path, names, *, seed=1, bias=(0.0, 1.0), share=1e-3, distances=4, frequencies=FREQUENCIES):
    """Two runs, with errors of a share of each magnitude; without columns of a bias where there is none."""
    box, generator = model.validity, np.random.default_rng(seed)
    distance = np.linspace(1.02 * box.distance_min_m, 0.98 * box.distance_max_m, distances)
    grid = np.meshgrid([1, 2], distance, bias, frequencies, indexing="ij")
    run, d, i, f = (one.ravel() for one in grid)
    rows = {"run": run, "gap [mm]": 1e3 * d, "f [kHz]": f / 1e3}
    if any(bias):
        rows |= {"current_inner_mA": 1e3 * i, "current_outer_mA": 0.0}
    z = impedances(model, d, np.stack([i, 0.0 * i], axis=1), f)
    for name in names:
        noisy = z[name] * (1.0 + share * (generator.standard_normal(len(d)) + 1j * generator.standard_normal(len(d))))
        rows[f"impedance_{name}_ohm"] = np.abs(noisy)
        rows[f"phase_{name}_deg"] = np.degrees(np.angle(noisy))
    pd.DataFrame(rows).to_csv(path, index=False)
    return path


@pytest.fixture
def points():
    d, f = (one.ravel() for one in np.meshgrid([0.018, 0.03, 0.044], [1.0, 50.0, 400.0, 5e3], indexing="ij"))
    return d, np.full(len(d), 0.4), f


def test_the_halves_in_series_have_the_impedance_of_the_whole(whole, model, points):
    d, i, f = points
    z = impedances(model, d, np.stack([i, i], axis=1), f)
    together = z["inner"] + z["outer"] + z["inner_outer"] + z["outer_inner"]
    np.testing.assert_allclose(together, impedances(whole, d, i, f)[""], rtol=1e-9)
    np.testing.assert_allclose(z["inner_outer"], z["outer_inner"], rtol=1e-12)  # reciprocity


def test_one_beside_another_that_is_shorted_is_seen_through_the_admittance(model, points):
    d, i, f = points
    i = np.stack([i, i], axis=1)
    y = np.linalg.inv(model.impedance(d, i, f))
    z = impedances(model, d, i, f)
    np.testing.assert_allclose(z["inner_outer_shorted"], 1.0 / y[:, 0, 0], rtol=1e-9)
    np.testing.assert_allclose(z["outer_inner_shorted"], 1.0 / y[:, 1, 1], rtol=1e-9)


@pytest.mark.parametrize("names", [EACH, BOTH, SHORT, (*EACH, *BOTH), ("outer",)], ids="+".join)
def test_a_wrong_conductivity_is_named_from_whatever_was_read(levitation_model, model, tmp_path, names):
    wrong = replace(model, eddy=replace(model.eddy, resistances_ohm=model.eddy.resistances_ohm / 1.08))
    assert with_conductivity(levitation_model, 0.08).eddy.resistances_ohm == pytest.approx(wrong.eddy.resistances_ohm)
    found = diagnose(model, bench(wrong, tmp_path / "z.csv", names), bootstrap=0, rng=1)
    assert [one.name for one in found.missing] == [KEY]
    (added,) = add_effects(model, tmp_path / "z.csv", [KEY]).model.effects
    ((low, high),) = added.ci95.values()
    assert 0.0 < low < 0.08 < high
    for seed in range(4):
        clean = diagnose(model, bench(model, tmp_path / "z.csv", names, seed=seed), bootstrap=0, rng=1)
        assert clean.verdict == "nothing_missing"


@pytest.mark.parametrize(
    ("name", "size"), [("resistance:outer", {"resistance_error": 0.02}), ("turns:inner", {"turns_error": -0.01})]
)
def test_what_is_of_one_circuit_is_named_with_it(model, tmp_path, name, size):
    wrong = with_effects(model, [AddedEffect(effect_by_name(name), size)])
    path = bench(replace(wrong, base=None, effects=()), tmp_path / "z.csv", (*EACH, *BOTH))
    found = diagnose(model, path, bootstrap=0, rng=1)
    assert [one.name for one in found.missing] == [name]
    assert found.missing[0].parameters[next(iter(size))] == pytest.approx(next(iter(size.values())), rel=0.1)


def test_a_conductivity_that_was_added_is_kept_and_changes_every_impedance(model, tmp_path, points):
    d, i, f = points
    wrong = replace(model, eddy=replace(model.eddy, resistances_ohm=model.eddy.resistances_ohm / 1.2))
    added = add_effects(model, bench(wrong, tmp_path / "z.csv", EACH), [KEY]).model
    write_model(added, tmp_path / "model.json")
    again = read_model(tmp_path / "model.json")
    i = np.stack([i, i], axis=1)
    size = np.abs(wrong.impedance(d, i, f) - model.impedance(d, i, f)).max()
    assert np.abs(again.impedance(d, i, f) - wrong.impedance(d, i, f)).max() < 0.03 * size
    assert compare(again, tmp_path / "z.csv").verdict == "agrees"


def test_without_a_bias_no_circuit_carries_a_current(model, tmp_path):
    table = read_measurement(bench(model, tmp_path / "z.csv", EACH, bias=(0.0,)))
    comparison = compare(model, table)
    assert comparison.verdict == "agrees"
    assert "taken for 0 A" in str(comparison)
    assert set(comparison.observations.currents) == {"current_inner_A", "current_outer_A"}
    said = read_measurement(tmp_path / "z.csv", settings={"current_inner_mA": 300.0, "current_outer_A": 0.0})
    assert set(said.rows["current_inner_A"]) == {0.3}
    assert compare(model, said).verdict == "agrees"


def test_inductances_at_a_low_frequency_are_a_bench_s_channels_too(model, tmp_path):
    d, i = (one.ravel() for one in np.meshgrid(np.linspace(0.016, 0.044, 6), [0.2, 0.8, 1.2], indexing="ij"))
    inductance = model.magnetics.state(d, np.stack([i, i], axis=1)).inductance
    rows = {"distance_m": d, "current_inner_A": i, "current_outer_A": i}
    rows |= {"inductance_inner_H": inductance[:, 0, 0], "inductance_outer_inner_H": inductance[:, 0, 1]}
    runs, generator = [], np.random.default_rng(2)
    for run in (1, 2):
        noisy = pd.DataFrame(rows).assign(run=run)
        for name in ("inductance_inner_H", "inductance_outer_inner_H"):
            noisy[name] += 1e-6 * generator.standard_normal(len(d))
        runs.append(noisy)
    pd.concat(runs).to_csv(tmp_path / "l.csv", index=False)
    comparison = compare(model, tmp_path / "l.csv")
    assert comparison.verdict == "agrees"
    assert [one.rms for one in comparison.channels] == pytest.approx([1e-6, 1e-6], rel=0.35)  # of 36 readings


@pytest.mark.parametrize("column", ["inductance_H", "inductance_innner_H"])
def test_an_impedance_of_no_known_circuit_is_refused(model, tmp_path, column):
    path = bench(model, tmp_path / "z.csv", ("inner",))
    pd.read_csv(path).assign(**{column: 5e-3}).to_csv(path, index=False)
    with pytest.raises(TableError, match=column) as refused:
        compare(model, path)
    said = str(refused.value)
    assert "circuits inner, outer" in said
    assert "--column HEADER=inductance_inner_H" in said


def test_advice_for_several_circuits_names_the_frequencies_that_decide(model, tmp_path):
    """Far below the eddy currents' frequencies a conductivity changes the inductance as a wrong distance does."""
    wrong = replace(model, eddy=replace(model.eddy, resistances_ohm=model.eddy.resistances_ohm / 1.1))
    low = {"frequencies": (20.0, 30.0, 40.0, 50.0), "distances": 3, "bias": (0.0,)}
    advice = suggest(model, bench(wrong, tmp_path / "z.csv", ("inner",), **low))
    up = next(one for one in advice.suggestions if one.text.startswith("Go up to 500 Hz"))
    assert any({KEY, "distance_offset"} == set(pair[:2]) for pair in up.separates)


def test_what_no_inductance_gives_is_set_aside_of_a_circuit_whose_name_could_be_that_of_two(model, tmp_path):
    names, magnetics, eddy = ("coil_1", "coil_2"), model.magnetics, model.eddy
    circuits = tuple(replace(one, name=name) for one, name in zip(model.circuits, names, strict=True))
    renamed = replace(
        model,
        magnetics=replace(magnetics, names=names),
        circuits=circuits,
        eddy=replace(eddy, circuits=names),
        drawn=(),
    )
    path = bench(renamed, tmp_path / "z.csv", ("coil_1", "coil_1_coil_2"), bias=(0.0,))
    rows = pd.read_csv(path)
    beyond = rows["f [kHz]"] > 5.0
    rows.assign(phase_coil_1_deg=rows["phase_coil_1_deg"].where(~beyond, -80.0)).to_csv(path, index=False)
    comparison = compare(renamed, path)
    assert comparison.verdict == "agrees"
    assert [one.size for one in comparison.findings if one.code == "resonance"] == [beyond.sum()]


def test_currents_beyond_those_that_were_swept_are_said(model, tmp_path):
    inside, outside = (
        compare(model, bench(model, tmp_path / "z.csv", ("inner",), bias=bias)).findings for bias in ((0.5,), (5.0,))
    )
    assert not any(one.code == "extrapolated" for one in inside)
    assert any(one.code == "extrapolated" and "A and " in one.text for one in outside)


def test_at_a_low_frequency_a_shorted_winding_carries_nothing(model):
    """At a high one it takes its flux linkage away: L_1 - M^2 / L_2, here of windings without eddy currents."""
    bare, d, i = replace(model, eddy=None, drawn=()), np.full(2, 0.02), np.zeros((2, 2))
    found = predict_readings(
        bare, d, i, Conditions(nominal_of(bare), frequency_Hz=np.array([np.nan, 1e9])), channels=WANTED
    )
    inductance = bare.magnetics.inductance(d, i)[0] + bare.series_inductances_H
    left = inductance[0, 0] - inductance[0, 1] ** 2 / inductance[1, 1]
    assert found["inductance_inner_outer_shorted_H"] == pytest.approx([inductance[0, 0], left], rel=1e-9)
    assert left < 0.9 * inductance[0, 0]
