"""What closed loops cost; run with ``-m benchmark -s``."""

import time

import numpy as np
import pytest

from femfit.simulation.close_loop import run_loops
from femfit.simulation.design import design_loop
from femfit.simulation.experiment import Experiment
from femfit.simulation.study import closed_loop_study

pytestmark = pytest.mark.benchmark


@pytest.mark.parametrize("observer", ["ukf", "ukf4", "ekf", "direct"])
def test_a_thousand_loops_of_one_second(levitation_model, observer):
    design = design_loop(levitation_model)
    start = time.perf_counter()
    summary = run_loops(
        design,
        Experiment("backstepping", observer, design.targets_m),
        np.random.default_rng(1),
        runs=1000,
        duration_s=1.0,
    )
    print(
        f"\n1000 loops of {summary.steps} steps, {observer}: {time.perf_counter() - start:.1f} s",
        dict(summary.outcomes),
    )
    assert sum(summary.outcomes.values()) == 1000


def test_the_closed_loop_study(levitation_model):
    start = time.perf_counter()
    study = closed_loop_study(levitation_model)
    print(f"\nclosed-loop study: {time.perf_counter() - start:.1f} s")
    assert len(study.holds) == 8
