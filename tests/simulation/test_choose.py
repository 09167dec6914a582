"""Where no controller is asked for, the loop has the one whose linear loop is farthest from instability."""

from dataclasses import replace

import numpy as np
import pytest

import femfit.simulation.design
import femfit.simulation.experiment
from femfit.core.errors import DomainError
from femfit.simulation.adjust import choose
from femfit.simulation.close_loop import close_loop
from femfit.simulation.controllers import design_backstepping
from femfit.simulation.design import CONTROLLERS, LoopDesign, design_loop
from femfit.simulation.experiment import Experiment, LoopRuns
from femfit.simulation.margins import Margins, worst_of
from femfit.simulation.study import closed_loop_study

LATE = 40
"""Samples of 0.5 ms, two thirds of the time in which the body runs away by a factor e."""


@pytest.fixture(scope="module")
def late(optical):
    return design_loop(optical, latency=LATE)


@pytest.fixture
def growing(late, monkeypatch):
    """With backstepping's gains of the model's poles alone, with which this latency lets a deviation grow."""
    monkeypatch.setattr(
        femfit.simulation.design, "tuned_backstepping", lambda bench, points: design_backstepping(bench.model, points)
    )
    return replace(late)


def with_margins(monkeypatch, design, **each):
    """The design, whose controllers have margins as given: stable, modulus, share of the noise, rate of decay."""
    found = {
        name.replace("_", "-"): Margins(stable, 0.5, 2.0, 1.0, 1e-3, modulus, rate, noise)
        for name, (stable, modulus, noise, rate) in each.items()
    }
    monkeypatch.setattr(LoopDesign, "margins", lambda _, name, __: (found[name],))
    return choose(design, "ukf4")


@pytest.mark.parametrize(
    ("pid", "backstepping", "state_feedback", "order"),
    [
        ((True, 0.2, 0.1, 9.0), (True, 0.1, 0.1, 9.0), (True, 0.3, 0.1, 9.0), "state-feedback pid backstepping"),
        # Noise in the command cuts the margin: 0.05 of backstepping's are left, of the PID's 0.03
        ((True, 0.3, 1.1, 9.0), (True, 0.1, 0.2, 9.0), (False, 0.0, 0.01, -3.0), "backstepping pid state-feedback"),
    ],
)
def test_the_largest_margin_decides_and_a_loop_that_grows_comes_last(
    optical, monkeypatch, pid, backstepping, state_feedback, order
):
    each = {"pid": pid, "backstepping": backstepping, "state_feedback": state_feedback}
    assert list(with_margins(monkeypatch, design_loop(optical), **each)) == order.split()


@pytest.mark.nightly
def test_the_default_is_the_controller_with_the_largest_margin_and_holds(optical, late):
    loop = close_loop(optical, latency=LATE, runs=2, seconds=0.5)
    margins = {name: worst_of(late.margins(name, "ukf4")) for name in CONTROLLERS}
    assert loop.experiment.controller == max(margins, key=lambda name: (margins[name].kept, margins[name].modulus))
    assert loop.held == 2
    assert next(iter(loop.choice.margins)) == loop.experiment.controller
    assert loop.choice.lost == ()
    assert close_loop(optical, controller="pid", runs=1, seconds=0.01).choice is None


def test_a_loop_whose_linear_form_grows_is_not_simulated_as_a_remedy(growing, monkeypatch):
    def never(*_, **__):
        raise AssertionError

    monkeypatch.setattr(femfit.simulation.experiment, "run_experiments", never)
    experiment = Experiment("backstepping", "ukf", growing.targets_m)
    # Long enough for a deviation of a rounding to grow to the whole range
    steps = int(40.0 / growing.bench("ukf").growth(growing.controller("backstepping")) / growing.model.sample_time_s)
    loop = LoopRuns(growing, experiment, np.random.default_rng(1), 2, steps, steps, 0, None)
    assert not loop.held("with backstepping").any()


@pytest.mark.nightly
def test_a_latency_that_leaves_no_pid_is_named_and_nothing_unstable_is_advised(levitation_model):
    """At 22 mm the rig's magnet runs away by a factor e in 30 ms; 50 ms are more than any PID bears."""
    model = replace(levitation_model, reference_distances_m=(0.022,))
    design = design_loop(model, latency=100)
    reason = design.why_no("pid")
    assert "latency" in reason
    assert "50 ms" in reason
    bench = design.bench("ekf")
    assert bench.growth(design.controller("backstepping")) > 0.0
    assert "backstepping" not in reason
    assert not design_loop(model).why_no("pid")


@pytest.mark.nightly
def test_a_model_of_which_no_loop_is_stable_is_not_studied_but_told_why(levitation_model, monkeypatch):
    monkeypatch.setattr(LoopDesign, "why_no", lambda _, name: f"No {name}.")
    with pytest.raises(DomainError, match=r"No backstepping\. No pid\. No state-feedback\."):
        closed_loop_study(levitation_model)
