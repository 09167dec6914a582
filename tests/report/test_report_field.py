"""The field that is drawn is the field that was solved."""

import numpy as np
import pytest

from femfit.device.load import read_actuator
from femfit.field.sweep import plan_sweep, solve_task
from femfit.field.tolerance import SolverSettings
from femfit.report.field_cells import sample_field
from support.actuators import GEOMETRY

DISTANCE, CURRENT = 0.0225, 0.8  # on the sweep's grid, away from where a mesh is made


@pytest.fixture(scope="module")
def actuator():
    return read_actuator(GEOMETRY / "emaws-rig.toml")


@pytest.fixture(scope="module")
def sample(actuator):
    return sample_field(actuator, DISTANCE, CURRENT)


def test_the_force_beside_the_picture_is_the_sweeps(actuator, sample):
    task = next(t for t in plan_sweep(actuator, SolverSettings()) if t.distance == DISTANCE)
    swept = solve_task(task)["rows"]["force_N"][actuator.sweep.currents_A.index(CURRENT)]
    assert sample.force_N == pytest.approx(swept, rel=5e-4)  # two meshes, each within 0.02 %


def test_flux_and_flux_density_belong_together(actuator):
    """B_z = (1 / 2 pi r) d psi/dr and B_r = -(1 / 2 pi r) d psi/dz, in the air between magnet and core."""
    sample = sample_field(actuator, DISTANCE, CURRENT, SolverSettings(order=6))
    r, z, psi = sample.radius_m, sample.height_m, sample.flux_Wb
    in_z, in_r = np.gradient(psi, z, r)
    gap = np.ix_((z > 0.005) & (z < 0.018), (r > 0.004) & (r < 0.02))
    magnitude = np.hypot(in_z, in_r)[gap] / (2.0 * np.pi * r[gap[1].ravel()])
    # |B| jumps between elements by up to 0.4 %; psi does not
    np.testing.assert_allclose(magnitude, sample.flux_density_T[gap], rtol=5e-3)


def test_no_flux_passes_through_the_axis(sample):
    assert sample.radius_m[0] == 0.0
    np.testing.assert_array_equal(sample.flux_Wb[:, 0], 0.0)


def test_the_window_holds_every_part(actuator, sample):
    assert sample.height_m[0] < -0.025
    assert sample.height_m[-1] > DISTANCE + 0.005
    assert sample.radius_m[-1] > 0.02


def test_the_magnet_carries_about_a_tesla_and_the_core_less(sample):
    assert 0.5 < sample.part_flux_density_T["magnet"] < 1.45  # below its remanence
    assert max(sample.part_flux_density_T[n] for n in ("sleeve", "upper_flange", "lower_flange")) < 0.5
