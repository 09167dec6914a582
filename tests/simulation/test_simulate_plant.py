"""The plant obeys mechanics, circuit and energy; loops around a plant that is not the model."""

import json
from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import DomainError
from femfit.model.dynamics import runge_kutta_step
from femfit.model.json_file import write_model
from femfit.simulation.close_loop import run_loops
from femfit.simulation.design import design_loop
from femfit.simulation.experiment import Experiment
from femfit.simulation.plant import Plant, with_force_scale
from support.command import femfit
from support.one_current import flat


def test_a_scaled_force_keeps_reciprocity_and_scales_force_and_motional_constant(levitation_model):
    scaled = flat(with_force_scale(levitation_model, 1.01).magnetics)
    base = flat(levitation_model.magnetics)
    d, i, h = np.array([0.021, 0.029]), np.array([0.3, 0.8]), 1e-6
    np.testing.assert_allclose(scaled.force(d, i), 1.01 * base.force(d, i), rtol=1e-14)
    np.testing.assert_allclose(scaled.motional_constant(d, i), 1.01 * base.motional_constant(d, i), rtol=1e-14)
    slope = -(scaled.flux_linkage(d + h, i) - scaled.flux_linkage(d - h, i)) / (2.0 * h)
    np.testing.assert_allclose(scaled.motional_constant(d, i), slope, rtol=1e-5)  # rounding of 1e-16 Wb over 2e-6 m
    np.testing.assert_allclose(scaled.inductance(d, i), base.inductance(d, i), rtol=1e-3)  # k_m moves L by 0.01 %


def test_a_constant_disturbance_is_weight(levitation_model):
    heavier = replace(levitation_model, motion=replace(levitation_model.motion, gravity_m_s2=10.0))
    extra = levitation_model.motion.mass_kg * (10.0 - levitation_model.motion.gravity_m_s2)
    start, voltage = np.array([[0.024, 0.0, 0.3]]), np.array([1.0])
    np.testing.assert_allclose(
        runge_kutta_step(levitation_model, start, voltage, levitation_model.sample_time_s, disturbance=extra),
        Plant(heavier).step(start, voltage),
        rtol=1e-13,
    )


def held(model, plant, runs=4, seconds=0.4, **options):
    design = design_loop(model)
    experiment = Experiment("backstepping", "ukf", (0.022,), **options)
    return run_loops(design, experiment, np.random.default_rng(3), runs=runs, duration_s=seconds, plant=plant)


@pytest.fixture(scope="module")
def warm(levitation_model):
    """The same actuator with a winding that is 8 K warmer: 3.1 % more resistance."""
    circuit = replace(levitation_model.circuit, resistance_ohm=1.031 * levitation_model.circuit.resistance_ohm)
    return replace(levitation_model, circuits=(circuit,), name="warm")


@pytest.mark.nightly
def test_the_model_itself_as_plant_changes_nothing(levitation_model):
    own, none = (held(levitation_model, plant, runs=1, seconds=0.1) for plant in (levitation_model, None))
    assert own.estimate_rms_m == none.estimate_rms_m
    assert own.tracking_rms_m == none.tracking_rms_m


def test_a_warmer_winding_than_believed_moves_the_estimate_and_shows_in_the_innovations(levitation_model, warm):
    believed, true = held(levitation_model, warm), held(warm, warm)
    assert believed.outcomes == true.outcomes == {"HELD": 4}
    assert true.innovation_band.contains(true.normalised_innovation_squared)
    assert believed.normalised_innovation_squared > 1.5 * true.innovation_band.upper
    assert believed.estimate_rms_m.median > 2.0 * true.estimate_rms_m.median
    assert believed.tracking_rms_m.median > 2.0 * true.tracking_rms_m.median


def test_a_plant_that_cannot_hold_its_body_there_is_refused(levitation_model):
    heavy = replace(levitation_model, motion=replace(levitation_model.motion, mass_kg=0.1))
    with pytest.raises(DomainError):
        held(levitation_model, heavy)


@pytest.mark.nightly
def test_the_command_takes_the_plant_from_a_file(levitation_model, warm, tmp_path):
    for name, model in (("model", levitation_model), ("plant", warm)):
        write_model(model, tmp_path / f"{name}.json")
    done = femfit(
        "simulate", tmp_path / "model.json", "--plant", tmp_path / "plant.json", "--seconds", 0.2,
        "--json", tmp_path / "out.json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "out.json").read_text())["plant"] == "warm"
