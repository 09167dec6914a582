"""Truths of the trial against closed forms, limits and solutions by another way."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import DomainError
from femfit.device.load import read_actuator
from femfit.device.parts import LinearMaterial, NonlinearMaterial, Region
from femfit.tables.sweep_table import read_sweep_table
from femfit.trial.device import Device, Family, true_readings
from femfit.trial.drawing_variants import plunger_bore, scaled_turns, with_curve
from femfit.trial.field_table import FieldTable, solve_drawings
from femfit.trial.off_axis import core_response, displaced
from femfit.trial.shown import expected_fall
from femfit.trial.truths import magnetics, mechanics, memory, sets, warmth
from femfit.trial.truths.course import acting_only, only_in_some_runs
from femfit.trial.truths.preisach import lorentzian_ensemble
from femfit.trial.truths.sideways import magnet_beside
from femfit.trial.truths.truth import BENDS
from femfit.trial.virtual_bench import Meter
from support.actuators import GEOMETRY, assembly, rectangle
from support.closed_form_device import D, N, closed_form_device, conditions


@pytest.fixture(scope="module")
def device():
    return closed_form_device()


def changed(device, error, size, at):
    with_it = true_readings(device, at, {"it": size}, {"it": error})
    clean = true_readings(device, at, {}, {})
    return {channel: with_it[channel] - clean[channel] for channel in clean}


def built(truth, device, seed=1):
    return truth.build(device, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def linear(tmp_path_factory):
    """A magnet below a coil, and the same with the changes of two truths, solved."""
    disc = [Region("disc", rectangle(0.0, 0.01, 0.0, 0.005), LinearMaterial("magnet", 1.05, -1.2))]
    drawing = assembly(moving=disc, distances=(0.01, 0.03), coil=rectangle(0.008, 0.012, -0.01, -0.002), turns=100)
    forms = {"drawn": drawing, "fewer": scaled_turns(drawing, -0.2)}
    forms |= {
        f"{p:+g}": form for p, form in magnetics.remanence_drawings(drawing, "scaled")["remanence-scaled"].items()
    }
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("femfit.trial.field_table.LINEAR_DISTANCES", 3)
        tables = solve_drawings(forms, tmp_path_factory.mktemp("forms"), workers=1)
    family = Family((-0.1, 0.1), (tables["-0.1"], tables["+0.1"]), tables["drawn"])
    return Device(drawing, tables["drawn"], {"remanence-scaled": family}), tables["fewer"]


def test_a_weaker_magnet_scales_its_flux_exactly(linear):
    device, _ = linear
    at = conditions(0.0, distance=np.array([0.012, 0.02]))
    drawn = device.drawn.at(at.distance, at.current)
    change = changed(device, built(magnetics.weaker_magnets("scaled"), device), -0.07, at)
    np.testing.assert_allclose(change["flux_linkage_Wb"], -0.07 * drawn.flux_linkage, rtol=1e-9)
    at = conditions(1.0, distance=np.array([0.012, 0.02]))
    ahead, back = (device.drawn.at(at.distance, sign * at.current).force for sign in (1.0, -1.0))
    change = changed(device, built(magnetics.weaker_magnets("scaled"), device), -0.07, at)["force_N"]
    # No iron: without the coil's pull at the magnet's permeability all force is in proportion to the magnet
    np.testing.assert_allclose(change, -0.07 * 0.5 * (ahead - back), rtol=1e-6)


def test_fewer_turns_are_the_solution_with_fewer_turns(linear):
    device, fewer = linear
    at = conditions(0.7, distance=np.array([0.012, 0.02]))
    change = changed(device, built(magnetics.lost_turns("everywhere"), device), 0.2, at)
    drawn, solved = (table.at(at.distance, at.current) for table in (device.drawn, fewer))
    np.testing.assert_allclose(change["force_N"], solved.force - drawn.force, rtol=1e-6)
    np.testing.assert_allclose(change["flux_linkage_Wb"], solved.flux_linkage - drawn.flux_linkage, rtol=1e-6)


@pytest.mark.parametrize(("shape", "acts"), [("begins", (False, True)), ("ends", (True, False))])
def test_a_step_is_away_on_one_side_and_whole_on_the_other(device, shape, acts):
    at = conditions(1.0, 40.0, runs=5)
    for name in ("remanence", "distance_offset", "force_gain"):
        truths = sets.truths_of(GEOMETRY / "emaws-rig.toml", "calibration")
        whole = built(truths[f"{name} (calibration)"], device)
        step = built(only_in_some_runs(truths[f"{name} (calibration)"], name, shape), device)
        assert step.names == (name,)
        first, last = step.course(5)
        assert (first > 1, last < 5) == (not acts[0], not acts[1])
        size = 0.3 * whole.limit(device)
        always, now = changed(device, whole, size, at), changed(device, acting_only(step, (first, last)), size, at)
        inside = (at.run + 1 >= first) & (at.run + 1 <= last)
        for channel, values in now.items():
            np.testing.assert_array_equal(values[~inside], 0.0)
            np.testing.assert_allclose(values[inside], always[channel][inside], rtol=1e-12, atol=1e-18)


def test_an_interval_is_within_the_campaign_and_not_all_of_it(device):
    truth = sets.truths_of(GEOMETRY / "emaws-rig.toml", "final")["resistance interval (final)"]
    for seed in range(50):
        first, last = built(truth, device, seed).course(4)
        assert 1 <= first <= last <= 4
        assert (first, last) != (1, 4)


def test_a_wall_that_is_hardly_pinned_follows_the_anhysteretic_curve():
    cycle = np.tile(np.concatenate([np.linspace(-1, 1, 41), np.linspace(1, -1, 41)]), 2)
    free, pinned = (memory.jiles_atherton(cycle, pinning, 0.3, 0.1)[82:] for pinning in (0.003, 0.2))
    assert np.abs(free).max() < 0.05 * np.abs(pinned).max()
    # What lags is left behind by rising currents and ahead of falling ones, and the loop closes
    assert (pinned[60:80] > pinned[1:21][::-1]).all()
    again = memory.jiles_atherton(np.tile(cycle[:82], 6), 0.2, 0.3, 0.1)
    np.testing.assert_allclose(again[-82:], again[-164:-82], atol=1e-3 * np.abs(pinned).max())


def test_relays_with_heavy_tails_wipe_out_smaller_excursions():
    relays = lorentzian_ensemble(0.2, 0.3, 0.4)
    assert (relays.up > relays.down).all()
    assert relays.output(np.array([0.0, 2.0, -0.3]))[-1] == relays.output(np.array([0.0, 0.4, 0.1, 2.0, -0.3]))[-1]


def test_bristles_that_bend_at_once_are_dry_friction(device):
    current = np.concatenate([np.linspace(0, 1.4, 8), np.linspace(1.4, 0, 8)])
    at = conditions(current, distance=np.full(16, 0.02))
    dry, stiff = (built(mechanics.friction(law), device) for law in ("coulomb", "stribeck"))
    change = changed(device, dry, 1e-3, at)["force_N"]
    np.testing.assert_allclose(change[1:8], -1e-3)  # the force grows: its reading stays behind
    np.testing.assert_allclose(change[9:], 1e-3)
    # Large steps leave Stribeck's fall behind
    assert (np.abs(changed(device, stiff, 1e-3, at)["force_N"][1:8]) >= 1e-3).all()
    bristles = changed(device, built(mechanics.friction("lugre"), device), 1e-3, at)["force_N"]
    assert np.abs(bristles[1]) < 2e-3
    assert (np.diff(bristles[8:]) > 0.0).all()


def test_a_lag_follows_its_exponential():
    at = conditions(0.0, distance=np.full(40, 0.02))
    step = np.r_[0.0, np.ones(39)]
    np.testing.assert_allclose(warmth.lagged(step, at, 70.0), 1.0 - np.exp(-at.time_s / 70.0), rtol=1e-12)


def test_a_screw_comes_back_after_its_pitch(device):
    error = built(mechanics.screw("sine"), device)
    distance = np.array([0.018, 0.018 + error.constants["pitch_m"]])
    moved = error.setting(device, 1e-5, conditions(0.0, distance=distance)).distance - distance
    assert moved[0] == pytest.approx(moved[1], abs=1e-12)
    assert np.abs(moved).max() <= 1e-5


def test_every_law_of_saturation_starts_at_the_drawn_permeability_and_holds_its_polarisation():
    core = [Region("core", rectangle(0.0, 0.01, -0.02, 0.0), LinearMaterial("ferrite", 500.0))]
    drawing = assembly(fixed=core, moving=[Region("disc", rectangle(0, 0.01, 0, 0.005), LinearMaterial("m", 1.0, 1.0))],
                       distances=(0.01, 0.02))  # fmt: skip
    for law in sets._SATURATION:
        material = with_curve(drawing, law, 0.5).fixed[0].material
        assert isinstance(material, NonlinearMaterial)
        assert material.relative_permeability == pytest.approx(500.0, rel=0.03)
        polarisation = material.flux_density_T[-1] - 4e-7 * np.pi * material.field_A_per_m[-1]
        assert polarisation == pytest.approx(0.5, rel=0.03)


def test_a_magnet_little_beside_the_axis_sees_the_curvature_of_the_coils_field():
    # Harmonic and symmetric: f(d, e) = f - (e^2 / 4) f'' + ..., for the flux of the coil through the magnet
    rig = read_actuator(GEOMETRY / "emaws-rig.toml")
    d, h = np.geomspace(0.016, 0.04, 9), 2e-4
    off = displaced(rig, 1e-3, (0.016, 0.04), 9)

    def flux(distance):
        from femfit.trial.off_axis import _coil_potential, _magnet_charges

        charge, point = _magnet_charges(rig, distance, 0.0)
        return float(charge @ _coil_potential(rig, core_response(rig), point))

    curvature = np.array([(flux(x + h) - 2.0 * flux(x) + flux(x - h)) / h**2 / flux(x) for x in d])
    np.testing.assert_allclose(off.flux, -0.25 * curvature, rtol=0.01)  # the next order: e^2 / 16 f''''


def test_offsets_of_half_the_magnets_radius_leave_the_parabola(device):
    at = conditions(1.0)
    half, largest = np.full(N, 2.75e-3), 2.75e-3
    whole, small = (magnet_beside(device, part * half, largest, at) for part in (1.0, 0.05))
    bent = whole.hall / (400.0 * small.hall)
    assert np.all(np.abs(bent - 1.0) < 0.2)
    assert np.abs(bent - 1.0).max() > 0.01
    # What is interpolated between the solved offsets is the solution there
    exact = displaced(device.actuator, 0.4 * largest, device.drawn.distances)
    at_nearest = np.interp(np.log(D), exact.log_distance, exact.hall) * (0.4 * largest) ** 2
    hall = device.drawn.at(D, np.zeros(N)).hall
    np.testing.assert_allclose(magnet_beside(device, 0.4 * half, largest, at).hall / hall, at_nearest, rtol=1e-3)


def test_the_bore_of_a_frame_that_is_one_polygon_is_found():
    region, bore, plunger = plunger_bore(read_actuator(GEOMETRY / "solenoid.toml"))
    assert (region.name, bore, plunger) == ("frame", pytest.approx(5.3e-3), pytest.approx(5e-3))


def test_a_stronger_load_of_the_drawn_spring_is_the_springs_force(device):
    solenoid = read_actuator(GEOMETRY / "solenoid.toml")
    with_spring = replace(device, actuator=replace(device.actuator, mechanics=solenoid.mechanics))
    change = changed(with_spring, built(mechanics.carried_spring(BENDS["odd"]), with_spring), 1.0, conditions())
    push = 1.0 + 400.0 * (4e-3 - D)
    assert np.all(np.abs(change["force_N"] + push) <= 0.1001 * np.abs(push))


def test_a_table_through_zero_is_a_polynomial_in_the_distance():
    x = np.cos(np.pi * (np.arange(6) + 0.5) / 6)[::-1]
    d = -6e-3 + 4e-3 * x
    inverse = np.linalg.inv(np.polynomial.chebyshev.chebvander(x, 5))
    values = np.array([[1e9 * d**3, d, 0.0 * d]] * 3).transpose(0, 2, 1)
    table = FieldTable((-10e-3, -2e-3), np.einsum("ak,ckj->caj", inverse, values))
    at = np.array([-9e-3, -3.3e-3])
    np.testing.assert_allclose(table.at(at, np.array([2.0, -1.0])).force, 1e9 * at**3 + at * [2.0, -1.0], rtol=1e-9)


def test_the_fall_is_that_of_the_whole_covariance():
    rng, n = np.random.default_rng(4), 12
    run, mount_m = np.repeat([0, 1], n // 2), 2e-5
    meters = {"force_N": Meter(0.02, 0.4, 1.0), "hall_V": Meter(0.01, 0.0, 5.0)}
    change, slope = ({name: rng.standard_normal(n) * scale for name in meters} for scale in (0.03, 800.0))
    kept = {name: rng.random(n) > 0.2 for name in meters}
    blocks = [
        meter.sigma**2 * meter.rho ** np.abs(np.subtract.outer(np.arange(n), np.arange(n))) * (run[:, None] == run)
        + meter.step**2 / 12.0 * np.eye(n)
        for meter in meters.values()
    ]
    covariance = np.block([[blocks[0], np.zeros((n, n))], [np.zeros((n, n)), blocks[1]]])
    stacked, both = np.concatenate([slope[name] for name in meters]), np.tile(run, 2)
    covariance += mount_m**2 * np.outer(stacked, stacked) * (both[:, None] == both)
    there = np.concatenate([kept[name] for name in meters])
    delta = np.concatenate([change[name] for name in meters])[there]
    whole = delta @ np.linalg.solve(covariance[np.ix_(there, there)], delta)
    assert expected_fall(change, slope, kept, meters, run, mount_m) == pytest.approx(whole)


def test_a_saturating_drawing_without_magnets_is_mirrored_and_exact_where_it_is_measured(monkeypatch, tmp_path):
    monkeypatch.setattr("femfit.trial.field_table.SATURATING_DISTANCES", 2)
    monkeypatch.setattr("femfit.trial.field_table.CURRENTS", 2)
    h = np.array([0.0, 100.0, 400.0, 2000.0, 1e5])
    steel = NonlinearMaterial("steel", tuple((4e-7 * np.pi * h + 1.6 * np.tanh(h / 300.0)).tolist()), tuple(h.tolist()))
    drawing = assembly(
        moving=[Region("disc", rectangle(0.0, 0.01, 0.0, 0.005), steel)], distances=(0.004, 0.01),
        coil=rectangle(0.008, 0.012, -0.01, -0.002), turns=2000,
    )  # fmt: skip
    table = solve_drawings({"drawn": drawing}, tmp_path, workers=1)["drawn"]
    rows = read_sweep_table(tmp_path).rows
    assert table.currents == pytest.approx((-1.05, -1.0, 0.0, 1.0, 1.05))
    assert sorted(set(rows["current_A"])) == pytest.approx([0.0, 1.0, 1.05])
    d, i = rows["distance_m"].to_numpy(), rows["current_A"].to_numpy()
    for sign in (-1.0, 1.0):
        at = table.at(d, sign * i)
        np.testing.assert_allclose(at.force, rows["force_N"], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(at.flux_linkage, sign * rows["flux_linkage_Wb"], rtol=1e-9, atol=1e-12)
    with pytest.raises(DomainError, match=r"currents .* between -1.05 and 1.05 A"):
        table.at(d[:1], np.array([1.1]))
