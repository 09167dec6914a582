"""Benches, records and impedances of several circuits beside their model; halves are the whole."""

import copy
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.core.errors import ModelFileError, TableError, UsageError
from femfit.effects.catalogue import device_effects, effect_by_name
from femfit.effects.conditions import Conditions
from femfit.fit.sensed_field import fit_sensed
from femfit.identify.plan import examine_plan
from femfit.identify.series.observations import series_observations
from femfit.identify.signatures import why_untestable
from femfit.model.drawn_effect import DrawnEffect
from femfit.model.json_file import model_from_dict, model_to_dict
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of, with_effects
from support.bearing import NAMES as BEARING_COILS
from support.bearing import table_of
from support.campaign import hidden
from support.closed_loop import recorded
from support.eddies import with_eddies
from support.halves import NAMES, cut_in_two, halves_with_eddies
from support.impedances import FREQUENCIES, KEY, noisy, with_conductivity
from support.readings import hall_voltage

NOISE = {"force_N": 0.3, "flux_linkage": 2e-5, "voltage": 2e-3}


@pytest.fixture(scope="module")
def bearing():
    """The bearing with bridges; its bias magnet is known from its forces without current."""
    return ff.fit_model(table_of()).model


def bench(model, path, *, gain=(1.0, 1.0), resistance=(1.0, 1.0)):
    """Two runs of one mounting over distances and both currents, with wrong ammeters and resistances."""
    generator = np.random.default_rng(1)
    grid = np.meshgrid([1, 2], np.linspace(0.28e-3, 0.72e-3, 7), [-1.5, 0, 1.5], [-1.5, 0, 1.5], indexing="ij")
    run, d, *i = (axis.ravel() for axis in grid)
    true = np.stack(i, axis=1) * gain
    flux, noise = model.magnetics.flux_linkage(d, true), generator.normal(size=(5, len(d)))
    rows = {"run": run, "mount": 1, "distance_m": d, "current_lower_A": i[0], "current_upper_A": i[1]}
    rows["force_N"] = model.magnetics.force(d, true) + NOISE["force_N"] * noise[4]
    for k, name in enumerate(BEARING_COILS):
        ohms = model.circuits[k].resistance_ohm * resistance[k]
        rows[f"flux_linkage_{name}_Wb"] = flux[:, k] + NOISE["flux_linkage"] * noise[k]
        rows[f"voltage_{name}_V"] = ohms * true[:, k] + NOISE["voltage"] * noise[2 + k]
    pd.DataFrame(rows).to_csv(path, index=False)
    return path


@pytest.mark.parametrize(
    ("renamed", "lacking"),
    [
        ("current_A", r"lacks current_\w+_A, current_\w+_A .*--column HEADER=current_\w+_A"),
        ("current_upper_A", "current_lower_A"),
    ],
)
def test_one_current_of_a_grid_of_both_is_not_taken_for_none_in_the_other(bearing, tmp_path, renamed, lacking):
    rows = pd.read_csv(bench(bearing, tmp_path / "bench.csv")).drop(columns="current_lower_A")
    rows.rename(columns={"current_upper_A": renamed}).to_csv(tmp_path / "one.csv", index=False)
    with pytest.raises(TableError, match=lacking):
        ff.compare(bearing, tmp_path / "one.csv")


def test_what_is_found_is_added_kept_and_shown(bearing, tmp_path):
    file = bench(bearing, tmp_path / "bench.csv", gain=(1.04, 1.0), resistance=(1.0, 1.05))
    found = ff.diagnose(bearing, file)
    added = ff.add_effects(bearing, file, found)
    ff.write_model(added.model, tmp_path / "model.json")
    again = ff.read_model(tmp_path / "model.json")
    assert {one.effect.name for one in again.effects} == {"current_gain:lower", "resistance:upper"}
    assert again.circuits[1].resistance_ohm == pytest.approx(1.05 * bearing.circuits[1].resistance_ohm, rel=1e-3)
    assert copy.deepcopy(again.effects)[0].effect is again.effects[0].effect
    assert ff.compare(again, file).verdict == "agrees"
    assert "circuit lower" in str(found)
    assert "current_gain:lower" in str(ff.suggest(bearing, file, found))


def test_only_effects_that_several_circuits_can_have_are_considered(bearing):
    names = list(device_effects(BEARING_COILS))
    assert "current_gain:lower" in names
    assert not {"current_gain", "hysteresis"} & set(names)
    assert list(device_effects(("coil",)))[:3] == ["distance_offset", "remanence", "turns"]
    with pytest.raises(UsageError):
        effect_by_name("hysteresis:lower")


def test_effects_that_act_on_no_current_stand_in_the_file_of_any_device(bearing):
    names = ("viscous_friction", "force_offset", "spring", "end_stop_contact", "constant_force", "fluid_drag")
    named = [{"name": "coulomb_friction", "parameters": {"level": 0.1}}, *({"name": name} for name in names)]
    model = model_from_dict(model_to_dict(bearing) | {"effects": named})
    assert model.effects[0].parameters == {"level": 0.1, "breakaway": 0.0, "creep_m_s": 1e-3}
    with pytest.raises(ModelFileError, match=r"core_saturation\. Take them out of its effects\.$"):
        model_from_dict(model_to_dict(bearing) | {"effects": [{"name": "core_saturation"}]})


def test_turns_and_remanence_scale_the_sources_of_the_one_coenergy(bearing):
    changed = with_effects(bearing, [hidden("turns:lower", turns_error=0.1), hidden("remanence", remanence_error=-0.2)])
    d, i = np.linspace(0.3e-3, 0.7e-3, 5), np.tile([0.8, -0.4], (5, 1))
    force, before = changed.magnetics.force(d, np.zeros((5, 2))), bearing.magnetics.force(d, np.zeros((5, 2)))
    np.testing.assert_allclose(force, 0.8**2 * before, rtol=1e-9)
    more = 1.1**2 * bearing.magnetics.inductance(d, i)[:, 0, 0]
    np.testing.assert_allclose(changed.magnetics.inductance(d, i)[:, 0, 0], more, rtol=1e-12)
    assert changed.circuits[0].resistance_ohm == pytest.approx(1.1 * bearing.circuits[0].resistance_ohm)


def test_halves_are_compared_as_the_whole(levitation_model, tmp_path):
    """The same readings beside the coil and beside its halves leave the same errors."""
    whole = replace(levitation_model, sensor=None)
    grid = np.meshgrid([1, 2], np.linspace(0.017, 0.04, 8), np.linspace(0, 1.4, 5), indexing="ij")
    run, d, i = (axis.ravel() for axis in grid)
    force = 1.03 * whole.force(d, i) + 1e-4 * np.random.default_rng(7).normal(size=len(d))
    common = {"run": run, "distance_m": d, "force_N": force}
    pd.DataFrame({**common, "current_A": i}).to_csv(tmp_path / "one.csv", index=False)
    pd.DataFrame({**common, "current_inner_A": i, "current_outer_A": i}).to_csv(tmp_path / "two.csv", index=False)
    one, two = ff.compare(whole, tmp_path / "one.csv"), ff.compare(cut_in_two(whole), tmp_path / "two.csv")
    assert two.channels[0].rms == pytest.approx(one.channels[0].rms, rel=1e-9)
    assert two.channels[0].noise_floor == pytest.approx(one.channels[0].noise_floor, rel=1e-9)
    assert str(two).splitlines()[0] == str(one).splitlines()[0]


@pytest.fixture(scope="module")
def whole(model):
    return replace(model, sensor=None)


@pytest.fixture(scope="module")
def halves(whole):
    return cut_in_two(whole)


@pytest.fixture(scope="module")
def record(loops):
    return recorded(loops.drop(columns="hall_V"), distance_m=1e-5, runs=(1, 2))


def of_both(record, inner=1.0, noise_A=0.0):
    """The same record of the halves: the same current in each, and half of the voltage."""
    rows = record.rows.drop(columns=["current_A", "voltage_V"])
    current, volts = (record.rows[name].to_numpy() for name in ("current_A", "voltage_V"))
    noise = noise_A * np.random.default_rng(1).standard_normal((2, len(rows)))
    columns = {"current_inner_A": inner * current + noise[0], "current_outer_A": current + noise[1]}
    columns |= {f"voltage_{name}_V": 0.5 * volts for name in NAMES}
    return replace(record, rows=rows.assign(**columns), given=("run", "time_s", *columns, "distance_m"))


def test_the_balances_of_the_halves_are_those_of_the_whole(whole, halves, record):
    one, two = series_observations(whole, record), series_observations(halves, of_both(record))
    names = ["force_balance_N", *(f"voltage_balance_{name}_V" for name in NAMES)]
    assert two.channels == tuple(names)
    ratio = one.value / one.base  # of which the windows' weights by their noise fall out
    for name, of_whole in zip(names, ("force_balance_N", "voltage_balance_V", "voltage_balance_V"), strict=True):
        here = two.of(name)
        np.testing.assert_allclose(two.value[here] / two.base[here], ratio[one.of(of_whole)], rtol=1e-6)


@pytest.mark.parametrize(("name", "value"), [("mass_error", 0.1), ("distance_offset", 1e-4), ("position_delay", 1e-3)])
def test_an_effect_of_the_device_changes_the_halves_as_it_changes_the_whole(whole, halves, record, name, value):
    added = hidden(name, **{effect_by_name(name).parameters[0].name: value})
    change = []
    for model, data in ((whole, record), (halves, of_both(record))):
        observations = series_observations(model, data)
        moved = observations.predict([added]) - observations.base
        change.append([moved[observations.channel == c] for c in range(2)])
    for k, share in enumerate((1.0, 0.5)):
        scale = np.abs(change[0][k]).max()
        np.testing.assert_allclose(change[1][k], share * change[0][k], atol=0.01 * max(scale, 1e-12))


def test_a_wrong_ammeter_of_one_circuit_is_named_from_a_record(halves, record):
    found = ff.diagnose(halves, of_both(record, inner=1.0 / 1.1, noise_A=1e-4))
    (named,) = found.missing
    assert named.name == "current_gain:inner"
    assert named.parameters["gain_error"] == pytest.approx(0.1, abs=0.005)


def with_hall(model, levitation_model, distances, currents):
    """A model of two circuits with a Hall element that sees the first of them more."""
    d, *each = (axis.ravel() for axis in np.meshgrid(distances, currents, currents))
    values = 0.1 * (2.0 * each[0] + each[1]) * np.exp(-d / np.ptp(distances))
    field = fit_sensed(d, np.stack(each, axis=1), values, "hall").field
    return replace(model, sensor=replace(levitation_model.sensor, field=field, sensitivity_V_per_T=5.0))


def test_a_wrong_zero_of_a_hall_element_of_several_circuits_is_named_from_a_record(levitation_model, halves, record):
    model, data = with_hall(halves, levitation_model, np.linspace(0.01, 0.05, 12), [-1.5, 0.0, 1.5]), of_both(record)
    currents = data.rows[[f"current_{name}_A" for name in NAMES]].to_numpy()
    volts = model.sensor.output(data.rows["distance_m"].to_numpy(), currents) + 0.05
    volts += 1e-3 * np.random.default_rng(4).standard_normal(len(volts))
    found = ff.diagnose(model, replace(data, rows=data.rows.assign(hall_V=volts), given=(*data.given, "hall_V")))
    (named,) = found.missing
    assert named.name == "hall_offset"
    assert named.parameters["offset_V"] == pytest.approx(0.05, abs=1e-3)


def test_plant_and_filter_read_the_hall_element_of_several_circuits_as_a_bench_does(levitation_model, bearing):
    model = with_hall(bearing, levitation_model, np.linspace(0.2e-3, 0.8e-3, 12), [-2.0, 0.0, 2.0])
    d, i, time = np.array([0.4e-3, 0.5e-3]), np.array([[1.0, -1.0], [0.2, 0.4]]), 3.0
    at, states = (
        Conditions(nominal_of(model), time_s=time, elapsed=time, running=True),
        np.column_stack([d, 0.0 * d, i]),
    )
    causes = {
        "hall_offset": {"offset_V": 0.05},
        "hall_saturation": {"cubic_loss": 0.1},
        "hall_drift": {"run_settling_V": 0.03},
    }
    for name, size in causes.items():
        added = with_effects(model, [hidden(name, **size)])
        read = hall_voltage(added, states, time)
        np.testing.assert_allclose(read, predict_readings(added, d, i, at)["hall_V"], rtol=1e-12)
        assert np.all(np.abs(read - hall_voltage(model, states)) > 1e-4)


EACH, BOTH, SHORT = NAMES, ("inner_outer",), ("inner_outer_shorted",)
WANTED = ("inductance_H", "resistance_ohm")


@pytest.fixture(scope="module")
def eddied_whole(levitation_model):
    return replace(with_eddies(levitation_model), sensor=None)


@pytest.fixture(scope="module")
def eddied(eddied_whole):
    """Halves whose conductivity is a number of the drawing."""
    drawn = DrawnEffect(KEY, "the conductivity of core", "", 6.0, 0.1, conducts=True)
    return replace(halves_with_eddies(eddied_whole), drawn=(drawn,))


def impedances(model, d, i, f):
    """By the name in the column."""
    read = predict_readings(model, d, i, Conditions(nominal_of(model), frequency_Hz=f), channels=WANTED)
    names = [name.removeprefix("inductance").removesuffix("H").strip("_") for name in read if "inductance" in name]
    column = {name: f"_{name}_" if name else "_" for name in names}
    return {name: read[f"resistance{of}ohm"] + 2j * np.pi * f * read[f"inductance{of}H"] for name, of in column.items()}


def impedance_bench(model, path, names, *, seed=1, bias=(0.0, 1.0)):
    """Two runs, with errors of a share of each magnitude; without columns of a bias where there is none."""
    box, generator = model.validity, np.random.default_rng(seed)
    distance = np.linspace(1.02 * box.distance_min_m, 0.98 * box.distance_max_m, 4)
    grid = np.meshgrid([1, 2], distance, bias, FREQUENCIES, indexing="ij")
    run, d, i, f = (one.ravel() for one in grid)
    rows = {"run": run, "gap [mm]": 1e3 * d, "f [kHz]": f / 1e3}
    if any(bias):
        rows |= {"current_inner_mA": 1e3 * i, "current_outer_mA": 0.0}
    z = impedances(model, d, np.stack([i, 0.0 * i], axis=1), f)
    for name in names:
        read = noisy(z[name], 1e-3, generator)
        rows[f"impedance_{name}_ohm"], rows[f"phase_{name}_deg"] = np.abs(read), np.degrees(np.angle(read))
    pd.DataFrame(rows).to_csv(path, index=False)
    return path


def test_the_halves_in_series_are_the_whole_and_one_beside_the_other_shorted_is_seen_by_admittance(
    eddied_whole, eddied
):
    d, f = (one.ravel() for one in np.meshgrid([0.018, 0.03, 0.044], [1.0, 50.0, 400.0, 5e3], indexing="ij"))
    i = np.full((len(d), 2), 0.4)
    z, y = impedances(eddied, d, i, f), np.linalg.inv(eddied.impedance(d, i, f))
    together = z["inner"] + z["outer"] + z["inner_outer"] + z["outer_inner"]
    np.testing.assert_allclose(together, impedances(eddied_whole, d, i[:, 0], f)[""], rtol=1e-9)
    np.testing.assert_allclose(z["inner_outer"], z["outer_inner"], rtol=1e-12)  # reciprocity
    np.testing.assert_allclose(z["inner_outer_shorted"], 1.0 / y[:, 0, 0], rtol=1e-9)
    np.testing.assert_allclose(z["outer_inner_shorted"], 1.0 / y[:, 1, 1], rtol=1e-9)


READ = [BOTH, SHORT, *(pytest.param(one, marks=pytest.mark.nightly) for one in (EACH, ("outer",), (*EACH, *BOTH)))]


@pytest.mark.parametrize("names", READ)
def test_nothing_is_named_of_what_was_read_of_a_device_as_drawn(eddied, tmp_path, names):
    for seed in range(4 if "outer" in names else 1):
        path = impedance_bench(eddied, tmp_path / "z.csv", names, seed=seed)
        assert ff.diagnose(eddied, path).verdict == "nothing_missing"


@pytest.mark.parametrize("names", READ)
def test_a_wrong_conductivity_is_named_from_whatever_was_read(levitation_model, eddied, tmp_path, names):
    wrong = replace(eddied, eddy=replace(eddied.eddy, resistances_ohm=eddied.eddy.resistances_ohm / 1.08))
    assert with_conductivity(levitation_model, 0.08).eddy.resistances_ohm == pytest.approx(wrong.eddy.resistances_ohm)
    found = ff.diagnose(eddied, impedance_bench(wrong, tmp_path / "z.csv", names))
    assert [one.name for one in found.missing] == [KEY]
    (added,) = ff.add_effects(eddied, tmp_path / "z.csv", [KEY]).model.effects
    ((low, high),) = added.ci95.values()
    assert 0.0 < low < 0.08 < high


@pytest.mark.parametrize(
    ("name", "parameter", "size"),
    [("resistance:outer", "resistance_error", 0.02), ("turns:inner", "turns_error", -0.01)],
)
def test_what_is_of_one_circuit_is_named_with_it(eddied, tmp_path, name, parameter, size):
    wrong = with_effects(eddied, [hidden(name, **{parameter: size})])
    path = impedance_bench(replace(wrong, base=None, effects=()), tmp_path / "z.csv", (*EACH, *BOTH))
    (named,) = ff.diagnose(eddied, path).missing
    assert named.name == name
    assert named.parameters[parameter] == pytest.approx(size, rel=0.1)


def test_without_a_bias_no_circuit_carries_a_current(eddied, tmp_path):
    table = ff.read_measurement(impedance_bench(eddied, tmp_path / "z.csv", EACH, bias=(0.0,)))
    comparison = ff.compare(eddied, table)
    assert comparison.verdict == "agrees"
    assert set(comparison.observations.currents) == {"current_inner_A", "current_outer_A"}
    said = ff.read_measurement(tmp_path / "z.csv", settings={"current_inner_mA": 300.0, "current_outer_A": 0.0})
    assert set(said.rows["current_inner_A"]) == {0.3}
    assert ff.compare(eddied, said).verdict == "agrees"


@pytest.mark.parametrize("column", ["inductance_H", "inductance_innner_H"])
def test_an_impedance_of_no_known_circuit_is_refused(eddied, tmp_path, column):
    path = impedance_bench(eddied, tmp_path / "z.csv", ("inner",))
    pd.read_csv(path).assign(**{column: 5e-3}).to_csv(path, index=False)
    with pytest.raises(TableError, match=column) as refused:
        ff.compare(eddied, path)
    assert "inductance_inner_H" in str(refused.value)


def test_at_a_low_frequency_a_shorted_winding_carries_nothing(eddied):
    """At a high one it takes its flux linkage away: L_1 - M^2 / L_2, here of windings without eddy currents."""
    bare, d, i = replace(eddied, eddy=None, drawn=()), np.full(2, 0.02), np.zeros((2, 2))
    at = Conditions(nominal_of(bare), frequency_Hz=np.array([np.nan, 1e9]))
    found = predict_readings(bare, d, i, at, channels=WANTED)["inductance_inner_outer_shorted_H"]
    (one, mutual), (_, other) = bare.magnetics.inductance(d, i)[0] + bare.series_inductances_H
    assert found == pytest.approx([one, one - mutual**2 / other], rel=1e-9)


def test_a_plan_for_several_circuits_looks_at_what_these_can_have(bearing, tmp_path):
    report = examine_plan(bearing, ff.read_measurement(bench(bearing, tmp_path / "plan.csv")))
    assert {"turns:lower", "turns:upper"} <= report.detectable.keys()
    assert set(report.detectable) | set(report.invisible) <= set(device_effects(bearing.circuit_names))


def test_a_number_whose_field_is_not_followed_to_a_hall_element_is_looked_for_in_other_readings(
    levitation_model, eddied, tmp_path
):
    permeability = DrawnEffect("materials.core.relative_permeability", "the core", "", 200.0, 0.1, at_rest=True)
    model = with_hall(eddied, levitation_model, np.linspace(0.01, 0.05, 12), [-1.5, 0.0, 1.5])
    model = replace(model, drawn=(*model.drawn, permeability))
    path = impedance_bench(eddied, tmp_path / "z.csv", EACH)
    found = ff.diagnose(model, path)
    assert "hall_V" not in found.observations.channels
    assert not why_untestable(permeability.effect, found.observations)


def test_inductances_at_a_low_frequency_are_a_bench_s_channels_too(eddied, tmp_path):
    grid = np.meshgrid([1, 2], np.linspace(0.016, 0.044, 6), [0.2, 0.8, 1.2], indexing="ij")
    run, d, i = (one.ravel() for one in grid)
    inductance = eddied.magnetics.state(d, np.stack([i, i], axis=1)).inductance
    inductance = inductance + 1e-6 * np.random.default_rng(2).standard_normal(inductance.shape)
    rows = {"run": run, "distance_m": d, "current_inner_A": i, "current_outer_A": i}
    rows |= {"inductance_inner_H": inductance[:, 0, 0], "inductance_outer_inner_H": inductance[:, 0, 1]}
    pd.DataFrame(rows).to_csv(tmp_path / "l.csv", index=False)
    comparison = ff.compare(eddied, tmp_path / "l.csv")
    assert comparison.verdict == "agrees"
    assert [one.rms for one in comparison.channels] == pytest.approx([1e-6, 1e-6], rel=0.35)  # of 36 readings
