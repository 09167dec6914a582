"""A default design keeps the margins that sensors and supply allow, and says what takes them where it does not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import ss2tf

import femfit as ff
from femfit.device.electrics import CurrentSensor, PositionSensor
from femfit.model.json_file import write_model
from femfit.simulation.blind import blind_bound, zeros_of
from femfit.simulation.design import CONTROLLERS, design_loop
from femfit.simulation.margins import worst_of
from support.command import femfit


@pytest.fixture(scope="module")
def sensed(levitation_model):
    """The rig with a laser of 20 um and an ammeter of 4 mA in place of its Hall element."""
    laser = PositionSensor(
        name="laser", distances_m=(0.0, 0.1), readings=(0.0, 10.0), noise=2e-3, minimum=0.0, maximum=10.0, bits=14
    )
    ammeter = CurrentSensor(name="ammeter", noise=4e-3, circuit=levitation_model.circuit.name)
    return replace(levitation_model, sensor=None, other_sensors=(laser, ammeter))


def test_a_loop_of_good_sensors_keeps_45_degrees_and_half_a_modulus_margin(sensed):
    loop = ff.close_loop(sensed, estimator="ukf", runs=2, seconds=0.2)
    kept = worst_of(loop.design.margins(loop.experiment.controller, "ukf"))
    assert np.degrees(kept.phase_rad) >= 45.0
    assert kept.modulus >= 0.5
    assert kept.noise_share <= 0.1
    assert not kept.thin
    assert loop.held == 2


def test_a_filter_that_allows_for_an_error_of_the_commands_pays_for_the_margin_with_little(sensed):
    design = design_loop(sensed)
    trusting = replace(design, command_error=1.0)
    assert design.command_error > 1.0
    assert design.told[0] < 1.5 * trusting.told[0]
    for name in ("backstepping", "state-feedback"):
        assert worst_of(design.margins(name, "ekf")).modulus > worst_of(trusting.margins(name, "ekf")).modulus


def test_the_rigs_thin_loop_is_called_thin_with_what_takes_its_margin(levitation_model, sensed, tmp_path):
    """At 30 mm the rig's Hall element has a zero in the unstable half plane, which bounds every controller."""
    bound = blind_bound(design_loop(levitation_model).bench("ekf"))
    for name, model in (("thin", levitation_model), ("sound", sensed)):
        write_model(model, tmp_path / f"{name}.json")
        options = ("--runs", 1, "--seconds", 0.05, "--controller", "backstepping")
        done = femfit("simulate", tmp_path / f"{name}.json", *options)
        assert done.returncode == 0, done.stderr
        assert ("thin: " in done.stdout) == (name == "thin")
        if name == "thin":
            assert f"above {bound.modulus:.2g}" in done.stdout
            assert "on ukf" in done.stdout


def test_no_controller_beats_the_bound_of_a_zero_beside_the_unstable_pole(levitation_model):
    design = design_loop(levitation_model)
    bench = design.bench("ekf")
    bound = blind_bound(bench)
    # The bound of the continuous loop; the samples are short beside both times
    zero, pole = bound.zero_rad_s, bound.pole_rad_s
    assert bound.modulus == pytest.approx(abs(zero - pole) / (zero + pole), rel=1e-3)
    for plant in bench.plants:
        above, _ = ss2tf(plant.A, plant.B, plant.C[:, 0], np.zeros((1, 1)))
        expected = np.roots(np.trim_zeros(np.where(np.abs(above[0]) > 1e-12 * np.abs(above).max(), above[0], 0.0)))
        np.testing.assert_allclose(np.sort_complex(zeros_of(plant)), np.sort_complex(expected), rtol=1e-6)
    least = [worst_of(design.margins(name, observer)).modulus for name in CONTROLLERS for observer in ("ekf", "ekf4")]
    assert max(least) < bound.modulus
