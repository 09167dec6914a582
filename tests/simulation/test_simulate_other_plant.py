"""Loops around a plant that is another model than the one that controller and filter believe in."""

import json
from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import DomainError
from femfit.model.json_file import write_model
from femfit.simulation.close_loop import run_loops
from femfit.simulation.design import design_loop
from femfit.simulation.experiment import Experiment
from support.command import femfit


def held(model, plant, **options):
    design = design_loop(model)
    experiment = Experiment("backstepping", "ukf", (0.022,), **options)
    return run_loops(design, experiment, np.random.default_rng(3), runs=4, duration_s=0.4, plant=plant)


@pytest.fixture(scope="module")
def warm(levitation_model):
    """The same actuator with a winding that is 8 K warmer: 3.1 % more resistance."""
    circuit = replace(levitation_model.circuit, resistance_ohm=1.031 * levitation_model.circuit.resistance_ohm)
    return replace(levitation_model, circuits=(circuit,), name="warm")


def test_the_model_itself_as_plant_changes_nothing(levitation_model):
    own, none = held(levitation_model, levitation_model), held(levitation_model, None)
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


def test_the_command_takes_the_plant_from_a_file(levitation_model, warm, tmp_path):
    for name, model in (("model", levitation_model), ("plant", warm)):
        write_model(model, tmp_path / f"{name}.json")
    done = femfit(
        "simulate", tmp_path / "model.json", "--plant", tmp_path / "plant.json", "--seconds", 0.2,
        "--json", tmp_path / "out.json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "test-rig around the plant warm" in done.stdout
    assert json.loads((tmp_path / "out.json").read_text())["plant"] == "warm"
