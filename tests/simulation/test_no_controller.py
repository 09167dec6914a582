"""What is said where no controller is stable: the latency is named where it stands against one."""

from dataclasses import replace

import pytest

from femfit.simulation.design import design_loop


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
