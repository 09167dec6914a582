"""The bench of other physics: closed forms, limits, reciprocity, and three sets that share no truth."""

import json
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.constants import mu_0

from femfit.device.load import read_actuator
from femfit.device.parts import LinearMaterial, Region
from femfit.effects.catalogue import all_effects
from femfit.tables.measurement_file import read_bench_table
from femfit.trial.field_table import Device, solve_drawings, true_readings
from support.actuators import GEOMETRY, assembly, rectangle
from support.closed_form_device import DRAWING, closed_form_device, conditions
from support.trial import magnetics, memory, off_axis, sets
from support.trial.campaigns import measured_campaigns
from support.trial.records import CAUSES

DRAWINGS = ("emaws-rig", "solenoid", "voice-coil", "ball")


@pytest.fixture(scope="module")
def device():
    return closed_form_device()


def changed(device, error, size, settings):
    with_it = true_readings(device, settings, {"it": size}, {"it": error})
    clean = true_readings(device, settings, {}, {})
    return {channel: with_it[channel] - clean[channel] for channel in clean}


def built(truth, device, seed=1):
    return truth.build(device, np.random.default_rng(seed))


@pytest.mark.nightly
def test_a_weaker_magnet_and_fewer_turns_are_what_the_field_is_solved_to_be(tmp_path, monkeypatch):
    monkeypatch.setattr("femfit.trial.field_table.LINEAR_DISTANCES", 3)
    disc = [Region("disc", rectangle(0.0, 0.01, 0.0, 0.005), LinearMaterial("magnet", 1.05, -1.2))]
    drawing = assembly(moving=disc, distances=(0.01, 0.03), coil=rectangle(0.008, 0.012, -0.01, -0.002), turns=100)
    fewer = replace(drawing, coils=(replace(drawing.coil, turns=0.8 * drawing.coil.turns),))
    weaker = magnetics.remanence_drawings(drawing, "scaled")["remanence-scaled"]
    forms = {"drawn": drawing, "fewer": fewer} | {f"{p:+g}": form for p, form in weaker.items()}
    tables = solve_drawings(forms, tmp_path, workers=1)
    family = {-0.1: tables["-0.1"], 0.1: tables["+0.1"]}
    device = Device(drawing, tables["drawn"], {"remanence-scaled": family})
    settings = conditions(1.0, distance=np.array([0.012, 0.02]))
    passive, ahead, back = (device.drawn.at(settings.distance, sign * settings.current) for sign in (0.0, 1.0, -1.0))
    change = changed(device, built(magnetics.weaker_magnets("scaled"), device), -0.07, settings)
    np.testing.assert_allclose(change["flux_linkage_Wb"], -0.07 * passive[1], rtol=1e-9)
    # No iron: without the coil's pull at the magnet's permeability all force is in proportion to the magnet
    np.testing.assert_allclose(change["force_N"], -0.07 * 0.5 * (ahead[0] - back[0]), rtol=1e-6)
    change = changed(device, built(magnetics.lost_turns("everywhere"), device), 0.2, settings)
    solved = tables["fewer"].at(settings.distance, settings.current) - ahead
    np.testing.assert_allclose((change["force_N"], change["flux_linkage_Wb"]), solved[:2], rtol=1e-6)


@pytest.mark.parametrize("name", sets.SETS)
def test_a_truth_of_no_size_changes_nothing(name, device):
    settings = conditions(1.0, 40.0, 35.0)
    for truth, error in sets.truths_of(DRAWING, name).items():
        if not error.lacks(device.actuator) and "lateral" not in truth:  # a field that takes 15 s to solve
            for values in changed(device, built(error, device), 0.0, settings).values():
                np.testing.assert_allclose(values, 0.0, atol=1e-9, err_msg=truth)


def test_a_wall_that_is_hardly_pinned_follows_the_anhysteretic_curve():
    cycle = np.tile(np.concatenate([np.linspace(-1, 1, 41), np.linspace(1, -1, 41)]), 2)
    free, pinned = (memory.jiles_atherton(cycle, pinning, 0.3, 0.1)[82:] for pinning in (0.003, 0.2))
    assert np.abs(free).max() < 0.05 * np.abs(pinned).max()
    # What lags is left behind by rising currents and ahead of falling ones, and the loop closes
    assert (pinned[60:80] > pinned[1:21][::-1]).all()
    again = memory.jiles_atherton(np.tile(cycle[:82], 6), 0.2, 0.3, 0.1)
    np.testing.assert_allclose(again[-82:], again[-164:-82], atol=1e-3 * np.abs(pinned).max())


@pytest.mark.parametrize("ensemble", [memory.relay_ensemble, memory.lorentzian_ensemble])
def test_relays_close_their_loops_and_a_larger_excursion_erases_a_smaller_one(ensemble):
    relays = ensemble(0.2, 0.4, 0.4)
    cycle = np.concatenate([np.linspace(-1, 1, 41), np.linspace(1, -1, 41)])
    second, third = relays.irreversible(np.tile(cycle, 2))[82:], relays.irreversible(np.tile(cycle, 3))[164:]
    np.testing.assert_allclose(second, third, atol=1e-12)
    rising, falling = second[:41], second[41:][::-1]
    assert (falling - rising >= -1e-12).all()  # falling currents see more magnetisation
    assert (falling - rising).max() > 0.1
    assert relays.output(np.array([0.0, 2.0, -0.3]))[-1] == relays.output(np.array([0.0, 0.4, 0.1, 2.0, -0.3]))[-1]


@pytest.mark.nightly
def test_a_magnet_little_beside_the_axis_sees_the_curvature_of_the_coils_field():
    # Harmonic and symmetric: f(d, e) = f - (e^2 / 4) f'' + ..., for the flux of the coil through the magnet
    rig = read_actuator(DRAWING)
    d, h = np.geomspace(0.016, 0.04, 9), 2e-4
    ratios, core = off_axis.displaced(rig, 1e-3, (0.016, 0.04), 9), off_axis.core_of(rig)
    below, middle, above = np.array([[off_axis.coil_flux(rig, core, x + s, 0.0) for x in d] for s in (-h, 0.0, h)])
    curvature = (above - 2.0 * middle + below) / h**2 / middle
    np.testing.assert_allclose(ratios["flux"], -0.25 * curvature, rtol=0.01)  # the next order: e^2 / 16 f''''


@pytest.mark.parametrize(("distance", "converged_N"), [(0.02, 0.0261666), (0.03, 0.0045700)])
def test_the_core_seen_as_an_equipotential_attracts_like_the_solved_one(distance, converged_N):
    # mu_r 450 against infinity: the ideal core attracts by a few per cent more
    rig = read_actuator(DRAWING)
    core, energy = off_axis.core_of(rig), []
    for d in (distance - 1e-4, distance + 1e-4):
        charge, point = off_axis.magnet_charges(rig, d, 0.0)
        energy.append(0.5 * charge @ core.energy(charge, point, point) / (4.0 * np.pi * mu_0))
    assert 1.0 < (energy[1] - energy[0]) / 2e-4 / converged_N < 1.12


def truths(drawing):
    return {name: sets.truths_of(GEOMETRY / f"{drawing}.toml", name) for name in sets.SETS}


@pytest.mark.nightly
@pytest.mark.parametrize("drawing", DRAWINGS)
def test_sets_share_no_truth_and_say_what_a_drawing_lacks_and_which_name_is_right(drawing, device):
    actuator, members = read_actuator(GEOMETRY / f"{drawing}.toml"), truths(drawing)
    numbers = {
        name: {n.rpartition(" (")[0] for n, t in members[name].items() if t.group == "drawing"} for name in members
    }
    for first, second in combinations(sets.SETS, 2):
        assert numbers[first]
        assert not numbers[first] & numbers[second]
        assert not set(members[first]) & set(members[second])
    lacks = {name: truth.lacks(actuator) for name, truth in members["calibration"].items()}
    assert bool(lacks["hall_offset (calibration)"]) is (actuator.hall is None)
    assert bool(lacks["remanence (calibration)"]) is (drawing in {"solenoid", "ball"})
    assert bool(lacks["spring_in_force (calibration)"]) is not bool(actuator.mechanics.springs)
    assert bool(lacks["lateral_misalignment (calibration)"]) is (drawing in {"voice-coil", "ball"})
    assert not lacks["hysteresis (calibration)"]
    for name, truth in (item for set_members in members.values() for item in set_members.items()):
        if not truth.lacks(actuator):
            names = built(truth, replace(device, actuator=actuator)).names
            right = {name.rpartition(" (")[0]} if names is None else set(names)
            assert truth.group in {"drawing", "unseen"} or right & set(all_effects()), name
            assert truth.group != "unseen" or not right, name


def dealt(drawing):
    """The numbers of a drawing in all sets: truths by the first key path."""
    every = {name: truth for members in truths(drawing).values() for name, truth in members.items()}
    return {name.removeprefix("drawing:").rpartition(" (")[0]: truth for name, truth in every.items()}


def test_faces_that_touch_move_together_and_nothing_else_does():
    drawn, key = read_actuator(DRAWING), "fixed.regions.sleeve.r_mm[1]"
    truth = dealt("emaws-rig")[key]
    ((family, forms),) = truth.families(drawn).items()
    assert family == key
    assert truth.build(None, None).names == (key, "coils.coil.r_mm[0]")
    for change, form in forms.items():
        radius = 10e-3 + 1e-3 * change
        assert max(r for r, _ in form.fixed[1].vertices_m) == pytest.approx(radius)
        assert min(r for r, _ in form.coil.vertices_m) == pytest.approx(radius)
        assert form.moving == drawn.moving
        assert (form.fixed[0], form.fixed[2]) == (drawn.fixed[0], drawn.fixed[2])


@pytest.mark.nightly
def test_twenty_campaigns_of_a_set_hide_all_kinds_as_large_as_asked_and_declare_what_they_say(tmp_path, device):
    possible = {
        name: truth
        for name, truth in sets.truths_of(DRAWING, "calibration").items()
        if not truth.lacks(device.actuator) and "lateral" not in name
    }
    keys = []
    for campaign in measured_campaigns(device, 20, 5, sets.TruthSet("calibration", possible)):
        data = campaign.write(tmp_path / f"{campaign.number:04d}")
        keys.append(json.loads((data.parent / "hidden.json").read_text()))
        meters, declares = keys[-1]["meters"], keys[-1]["habits"]["noise_declared"]
        declared = {name: meter["sigma"] for name, meter in meters.items() if declares}
        assert dict(read_bench_table(data).declared_noise) == pytest.approx(declared, rel=1e-3)
        for name in keys[-1]["hidden"]:
            assert max(keys[-1]["over_noise"][name].values()) == pytest.approx(keys[-1]["level"], rel=0.01)
            assert keys[-1]["shown"][name] > 0.0
    groups = [tuple(key["group"].values()) for key in keys]
    assert len(keys) >= 17  # what cannot be as large as it should is left out
    assert {kind for group in groups for kind in group} == {"catalogue", "drawing", "when", "unseen"}
    assert groups.count(()) == 5
    assert any(key["when"] for key in keys)


def test_right_names_of_records_are_of_the_catalogue():
    assert {name for causes in CAUSES.values() for names in causes.values() for name in names} <= set(all_effects())
