"""The bench of other physics: closed forms, limits, reciprocity, and three sets that share no truth."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.constants import mu_0

import femfit as ff
from femfit.device.parts import LinearMaterial, Region
from femfit.effects.catalogue import all_effects
from femfit.tables.measurement_file import read_bench_table
from femfit.trial.field_table import Device, solve_drawings, true_readings
from support.actuators import GEOMETRY, assembly, rectangle
from support.closed_form_device import DRAWING, closed_form_device, conditions
from support.trial import magnetics, memory, off_axis, sets
from support.trial.campaigns import measured_campaigns
from support.trial.records import CAUSES


@pytest.fixture(scope="module")
def device():
    return closed_form_device()


def built(truth, device):
    return truth.build(device, np.random.default_rng(1))


def changed(device, truth, size, settings):
    """What a truth of a size changes of each channel."""
    errors = {"it": built(truth, device)}
    with_it, clean = (true_readings(device, settings, sizes, errors) for sizes in ({"it": size}, {}))
    return {channel: with_it[channel] - clean[channel] for channel in clean}


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
    change = changed(device, magnetics.weaker_magnets("scaled"), -0.07, settings)
    np.testing.assert_allclose(change["flux_linkage_Wb"], -0.07 * passive[1], rtol=1e-9)
    # No iron: without the coil's pull at the magnet's permeability all force is in proportion to the magnet
    np.testing.assert_allclose(change["force_N"], -0.07 * 0.5 * (ahead[0] - back[0]), rtol=1e-6)
    change = changed(device, magnetics.lost_turns("everywhere"), 0.2, settings)
    solved = tables["fewer"].at(settings.distance, settings.current) - ahead
    np.testing.assert_allclose((change["force_N"], change["flux_linkage_Wb"]), solved[:2], rtol=1e-6)


@pytest.mark.parametrize("name", sets.SETS)
def test_a_truth_of_no_size_changes_nothing(name, device):
    settings = conditions(1.0, 40.0, 35.0)
    for title, truth in sets.truths_of(DRAWING, name).items():
        if not truth.lacks(device.actuator) and "lateral" not in title:  # a field that takes 15 s to solve
            for values in changed(device, truth, 0.0, settings).values():
                np.testing.assert_allclose(values, 0.0, atol=1e-9, err_msg=title)


CYCLE = np.concatenate([np.linspace(-1, 1, 41), np.linspace(1, -1, 41)])


def test_a_wall_that_is_hardly_pinned_follows_the_anhysteretic_curve():
    free, pinned = (memory.jiles_atherton(np.tile(CYCLE, 2), pinning, 0.3, 0.1)[82:] for pinning in (0.003, 0.2))
    assert np.abs(free).max() < 0.05 * np.abs(pinned).max()
    # What lags is left behind by rising currents and ahead of falling ones, and the loop closes
    assert (pinned[60:80] > pinned[1:21][::-1]).all()
    again = memory.jiles_atherton(np.tile(CYCLE, 6), 0.2, 0.3, 0.1)
    np.testing.assert_allclose(again[-82:], again[-164:-82], atol=1e-3 * np.abs(pinned).max())


@pytest.mark.parametrize("ensemble", [memory.relay_ensemble, memory.lorentzian_ensemble])
def test_relays_close_their_loops_and_a_larger_excursion_erases_a_smaller_one(ensemble):
    relays = ensemble(0.2, 0.4, 0.4)
    second, third = (relays.irreversible(np.tile(CYCLE, n))[-82:] for n in (2, 3))
    np.testing.assert_allclose(second, third, atol=1e-12)
    lag = second[41:][::-1] - second[:41]  # falling currents see more magnetisation
    assert (lag >= -1e-12).all()
    assert lag.max() > 0.1
    assert relays.output(np.array([0.0, 2.0, -0.3]))[-1] == relays.output(np.array([0.0, 0.4, 0.1, 2.0, -0.3]))[-1]


@pytest.mark.nightly
def test_a_magnet_little_beside_the_axis_sees_the_curvature_of_the_coils_field():
    # Harmonic and symmetric: f(d, e) = f - (e^2 / 4) f'' + ..., for the flux of the coil through the magnet
    rig = ff.read_actuator(DRAWING)
    d, h = np.geomspace(0.016, 0.04, 9), 2e-4
    ratios, core = off_axis.displaced(rig, 1e-3, (0.016, 0.04), 9), off_axis.core_of(rig)
    below, middle, above = np.array([[off_axis.coil_flux(rig, core, x + s, 0.0) for x in d] for s in (-h, 0.0, h)])
    curvature = (above - 2.0 * middle + below) / h**2 / middle
    np.testing.assert_allclose(ratios["flux"], -0.25 * curvature, rtol=0.01)  # the next order: e^2 / 16 f''''


@pytest.mark.parametrize(("distance", "converged_N"), [(0.02, 0.0261666), (0.03, 0.0045700)])
def test_the_core_seen_as_an_equipotential_attracts_like_the_solved_one(distance, converged_N):
    # mu_r 450 against infinity: the ideal core attracts by a few per cent more
    rig = ff.read_actuator(DRAWING)
    core, energy = off_axis.core_of(rig), []
    for d in (distance - 1e-4, distance + 1e-4):
        charge, point = off_axis.magnet_charges(rig, d, 0.0)
        energy.append(0.5 * charge @ core.energy(charge, point, point) / (4.0 * np.pi * mu_0))
    assert 1.0 < (energy[1] - energy[0]) / 2e-4 / converged_N < 1.12


@pytest.mark.nightly
@pytest.mark.parametrize("drawing", ["emaws-rig", "solenoid", "voice-coil", "ball"])
def test_sets_share_no_truth_and_say_what_a_drawing_lacks_and_which_name_is_right(drawing, device):
    path = GEOMETRY / f"{drawing}.toml"
    actuator, members = ff.read_actuator(path), {name: sets.truths_of(path, name) for name in sets.SETS}
    titles = [title.rpartition(" (")[0] for truths in members.values() for title in truths if title[:8] == "drawing:"]
    assert len(titles) == len(set(titles)) >= len(sets.SETS)
    lacks = {name: truth.lacks(actuator) for name, truth in members["calibration"].items()}
    for name, lacking in (
        ("hall_offset", actuator.hall is None),
        ("remanence", drawing in {"solenoid", "ball"}),
        ("spring_in_force", not actuator.mechanics.springs),
        ("lateral_misalignment", drawing in {"voice-coil", "ball"}),
        ("hysteresis", False),
    ):
        assert bool(lacks[f"{name} (calibration)"]) is lacking
    for title, truth in (item for truths in members.values() for item in truths.items()):
        if not truth.lacks(actuator):
            names = built(truth, replace(device, actuator=actuator)).names
            right = {title.rpartition(" (")[0]} if names is None else set(names)
            assert truth.group in {"drawing", "unseen"} or right & set(all_effects()), title
            assert truth.group != "unseen" or not right, title
    causes = [name for of_device in CAUSES.values() for names in of_device.values() for name in names]
    assert set(causes) <= set(all_effects())


def test_faces_that_touch_move_together_and_nothing_else_does():
    drawn, key = ff.read_actuator(DRAWING), "fixed.regions.sleeve.r_mm[1]"
    every = [item for name in sets.SETS for item in sets.truths_of(DRAWING, name).items()]
    (truth,) = (truth for title, truth in every if title.startswith(f"drawing:{key} ("))
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
    truths, keys = sets.truths_of(DRAWING, "calibration").items(), []
    possible = {name: one for name, one in truths if not one.lacks(device.actuator) and "lateral" not in name}
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
