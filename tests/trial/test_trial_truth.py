"""The truths of the trial against closed forms, limits and reciprocity."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.constants import mu_0

from femfit.device.load import read_actuator
from femfit.trial import off_axis
from femfit.trial.drawing_variants import remembering_core
from femfit.trial.off_axis import core_response, displaced
from femfit.trial.truths.preisach import relay_ensemble
from support.trial import points_at
from support.trial_study.truth.bench import true_readings
from support.trial_study.truth.bench_effects import BENCH_EFFECTS, possible_effects
from support.trial_study.truth.families import family_drawings
from support.trial_study.truth.thermal import COPPER_PER_K, ThermalNetwork, heat

D = np.array([0.0163, 0.0221, 0.0307, 0.0412])


def changed(truth, name, size, distance, current, **constants):
    hidden = BENCH_EFFECTS[name].build(truth, np.random.default_rng(1))
    points = points_at(distance, current, **constants)
    with_it, without = true_readings(truth, points, [(hidden, size)]), true_readings(truth, points)
    return {channel: with_it[channel] - without[channel] for channel in without}


def test_the_solved_fields_reach_the_published_converged_values(rig_truth):
    # Converged values of this drawing with 30 turns, per turn: see the project's reference of the rig
    at = rig_truth.base.at(np.array([0.02, 0.03]), np.zeros(2))
    np.testing.assert_allclose(at.force, [0.0261666, 0.0045700], rtol=1e-3)
    np.testing.assert_allclose(at.hall, [0.0086864, 0.0028688], rtol=1e-3)


@pytest.mark.parametrize(
    ("family", "p"), [("core", 0.02), ("memory", 0.02), ("magnets", -0.05), ("layer", -0.3), ("ring", 1.0)]
)
def test_every_family_is_reciprocal(rig_truth, family, p):
    change, i = rig_truth.families[family].change, np.full(4, 1.0)
    by_current = (change(p, D, i + 0.1).force - change(p, D, i - 0.1).force) / 0.2
    by_distance = -(change(p, D + 2e-5, i).flux_linkage - change(p, D - 2e-5, i).flux_linkage) / 4e-5
    scale = np.abs(rig_truth.base.at(D, i).force - rig_truth.base.at(D, 0 * i).force)
    # two meshes of 1e-4 each stand behind a difference of solutions
    np.testing.assert_allclose(by_current, by_distance, rtol=2e-2, atol=3e-4 * scale.max())


def test_what_a_winding_leaves_in_iron_adds_to_its_own_flux(rig_truth):
    change = rig_truth.families["memory"].change(0.02, D, np.zeros(4))
    per_ampere = rig_truth.base.at(D, np.ones(4)).flux_linkage - rig_truth.base.at(D, np.zeros(4)).flux_linkage
    assert (change.flux_linkage * per_ampere > 0.0).all()


def test_iron_that_leads_the_flux_back_remembers_it_the_other_way():
    plunger = read_actuator(Path(__file__).parents[2] / "geometry" / "plunger-solenoid.toml")
    regions = {part.name: part.material.remanence_T for part in remembering_core(plunger, 0.1).fixed}
    assert regions == {"pole_and_bottom": 0.1, "shell": -0.1, "upper_plate": 0.0}


def test_a_weaker_magnet_attracts_the_core_less_by_twice_as_much(rig_truth):
    passive = rig_truth.base.at(D, np.zeros(4))
    change = rig_truth.families["magnets"].change(-0.01, D, np.zeros(4))
    np.testing.assert_allclose(change.force / passive.force, 0.99**2 - 1.0, rtol=1e-6)
    np.testing.assert_allclose(change.hall / passive.hall, -0.01, rtol=1e-6)


def test_a_lost_layer_and_a_lost_magnet_differ_in_shape(rig_truth):
    layer = rig_truth.families["layer"].change(-1.0, D, np.zeros(4))
    passive = rig_truth.base.at(D, np.zeros(4))
    share = layer.hall / passive.hall
    # The third next to the gap gives more than a third, and the more so the nearer
    assert (share < -1.0 / 3.0).all()
    assert (np.diff(share) > 0.0).all()


def test_the_core_seen_as_an_equipotential_attracts_like_the_solved_one(rig_truth):
    # mu_r 450 against infinity: the ideal core attracts by a few per cent more
    distances = (0.016, 0.04)
    core = core_response(rig_truth.actuator)
    for d in distances:
        energy = []
        for x in (d - 1e-4, d + 1e-4):
            charge, point = off_axis._magnet_charges(rig_truth.actuator, x, 0.0)
            energy.append(0.5 * charge @ core.energy(charge, point, point) / (4.0 * np.pi * mu_0))
        force = (energy[1] - energy[0]) / 2e-4
        solved = rig_truth.base.at(np.array([d]), np.zeros(1)).force[0]
        assert 1.0 < force / solved < 1.12


def test_a_coil_without_a_core_is_not_given_an_effect_that_needs_one(rig_truth):
    bare = replace(rig_truth.actuator, fixed=())
    assert set(family_drawings(rig_truth.actuator)) - set(family_drawings(bare)) >= {"core", "memory", "saturation-1"}
    assert "lateral_misalignment" in possible_effects(rig_truth)
    assert "lateral_misalignment" not in possible_effects(replace(rig_truth, actuator=bare))


def test_a_displaced_magnet_changes_with_the_square_of_the_displacement(rig_truth):
    one, two = (displaced(rig_truth.actuator, e, (0.015, 0.045), 4) for e in (0.5e-3, 1e-3))
    np.testing.assert_allclose(one.hall, two.hall, rtol=0.02)
    np.testing.assert_allclose(one.coil, two.coil, rtol=0.02, atol=5.0)
    assert (one.hall < 0.0).all()  # the element sits where the field on the axis is largest


def test_relays_close_their_loops_and_forget_nothing_they_should_keep():
    relays = relay_ensemble(0.2, 0.4, 0.4)
    cycle = np.concatenate([np.linspace(-1, 1, 41), np.linspace(1, -1, 41)])
    twice = relays.irreversible(np.tile(cycle, 2))
    rising, falling = twice[82:123], twice[123:][::-1]
    assert (falling - rising >= -1e-12).all()  # falling currents see more magnetisation
    assert (falling - rising).max() > 0.1
    np.testing.assert_allclose(twice[82:], relays.irreversible(np.tile(cycle, 3))[164:], atol=1e-12)
    # wiping out: a larger excursion erases a smaller one
    plain = relays.output(np.array([0.0, 2.0, -0.3]))[-1]
    detour = relays.output(np.array([0.0, 0.4, 0.1, 2.0, -0.3]))[-1]
    assert plain == detour


def test_a_winding_settles_where_power_and_loss_balance():
    network = ThermalNetwork(20.0, 100.0, 150.0, 20.0, 0.5, 0.8, 20.0)
    n = 400
    warm = heat(network, np.full(n, 1.4), np.zeros(n, dtype=int), np.full(n, 20.0), 10.0)
    rise = 20.0 / (1.0 - 20.0 * COPPER_PER_K)  # the warm winding takes more power at the same current
    assert warm.coil[-1] - 20.0 == pytest.approx(rise, rel=1e-3)
    assert warm.magnet[-1] - 20.0 == pytest.approx(0.5 * rise, rel=1e-3)
    assert warm.element[-1] - 20.0 == pytest.approx(0.8 * rise, rel=1e-3)


def test_a_warm_magnet_is_weaker_in_every_channel(rig_truth):
    change = changed(rig_truth, "magnet_temperature", 1.0, D, 1.0, magnet_C=50.0)
    base = true_readings(rig_truth, points_at(D, 1.0))
    assert (change["force_N"] < 0.0).all()
    relative = change["hall_V"] / (base["hall_V"] - 2.5)
    assert (relative < 0.0).all()
    assert (relative > -0.05).all()  # 30 K of NdFeB: 3.5 %, less with the coil's share


def test_an_outer_field_is_the_same_at_every_distance_in_the_flux_and_reaches_the_body(rig_truth):
    change = changed(rig_truth, "external_field", 1e-4, D, 0.0)
    flux = change["flux_linkage_Wb"]
    assert np.ptp(flux) < 0.05 * np.abs(flux).mean()
    # 308 turns of 15.3 mm effective radius; the core gathers some times as much field as passes a bare winding
    assert 2.0 < flux.mean() / (1e-4 * 308 * np.pi * 0.0153**2) < 8.0


def test_a_stop_pushes_away_and_touches_only_below_its_place(rig_truth):
    hidden = BENCH_EFFECTS["end_stop_contact"].build(rig_truth, np.random.default_rng(1))
    stop = hidden.constants["stop_m"]
    change = changed(rig_truth, "end_stop_contact", 1.0, np.array([stop - 1e-3, stop + 1e-3]), 0.0)["force_N"]
    np.testing.assert_allclose(change, [-(1e-3**1.5), 0.0])


def test_an_output_that_bends_never_gives_more_than_its_room(rig_truth):
    hall = true_readings(rig_truth, points_at(D, 1.4))["hall_V"]
    change = changed(rig_truth, "hall_saturation", 1.0, D, 1.4)["hall_V"]
    assert (np.abs(hall + change - 2.5) < 1.0).all()
    assert (np.sign(change) == -np.sign(hall - 2.5)).all()


def test_an_effect_of_no_size_changes_nothing(rig_truth):
    for name, entry in BENCH_EFFECTS.items():
        if entry.family and entry.family not in rig_truth.families:
            continue
        change = changed(rig_truth, name, 0.0, D, 1.0, coil_C=40.0, magnet_C=35.0, element_C=38.0)
        # a stage's finite steps and its screw's wobble remain: at most 5 um
        ahead, here = (true_readings(rig_truth, points_at(D + shift, 1.0)) for shift in (5e-6, 0.0))
        for channel, values in change.items():
            room = np.abs(ahead[channel] - here[channel]) if name.startswith("distance") else 0.0
            assert (np.abs(values) <= 1.01 * room + 1e-9).all(), (name, channel)
