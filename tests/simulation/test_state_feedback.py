"""Poles of state feedback, against the eigenvalues of plant and integral with its gains."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import DomainError
from femfit.simulation.adjust import adjusted
from femfit.simulation.design import design_loop


@pytest.fixture(scope="module")
def design(levitation_model):
    return design_loop(levitation_model)


@pytest.mark.parametrize("latency", [0, 2])
def test_poles_lie_where_they_are_given(design, latency):
    """Of x+ = A x + B u(k - q), q+ = q + t d, u = -K x - P (pending) - k q, all written out here."""
    poles = [-300.0, -120.0 + 60.0j, -120.0 - 60.0j, -40.0]
    late = replace(design, latency=latency)
    found = adjusted(late, "state-feedback", poles_rad_s=poles).controller("state-feedback")
    bench, step = late.bench("exact"), design.model.sample_time_s
    plant = bench.plants[bench.middle]
    loop = np.zeros((4 + latency, 4 + latency))
    law = -np.concatenate([found.gains[0], found.pending[0], found.integral])
    loop[:3, :3], loop[-1, -1], loop[-1, 0] = plant.A[:3, :3], 1.0, step
    if latency:
        loop[:3, 2 + latency] = plant.B[:3, 0]
        loop[3] = law
        for k in range(1, latency):
            loop[3 + k, 2 + k] = 1.0
    else:
        loop[:3] += np.outer(plant.B[:3, 0], law)
    multipliers = np.linalg.eigvals(loop)
    multipliers = multipliers[np.argsort(-np.abs(multipliers))]
    rates = np.log(multipliers[:4]) / step
    np.testing.assert_allclose(np.sort_complex(rates), np.sort_complex(np.array(poles)), rtol=1e-5)
    # Commands on their way stay at zero, where a double root splits by the root of rounding
    assert np.all(np.abs(multipliers[4:]) < 1e-3)


@pytest.mark.parametrize("lonely", [[-300.0, -200.0, -120.0 + 60.0j, -40.0], [-300.0, -9.0 + 2.0j, -9.0 + 2.0j, -40.0]])
def test_a_pole_without_its_conjugate_is_refused(design, lonely):
    with pytest.raises(DomainError, match="conjugate"):
        adjusted(design, "state-feedback", poles_rad_s=lonely)


def test_too_few_poles_are_refused_with_their_number(design):
    with pytest.raises(DomainError, match="instead received 1: -10"):
        adjusted(design, "state-feedback", poles_rad_s=[-10.0])
