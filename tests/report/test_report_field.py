"""What is drawn and written of a point is the field that was solved."""

import magpylib
import numpy as np
import pytest

from femfit.core.numerics import MU_0
from femfit.device.load import read_actuator
from femfit.device.materials import BHCurve
from femfit.field.tolerance import SolverSettings
from femfit.report.field_sample import solve_point, write_vtu
from support.actuators import GEOMETRY, assembly, magnet
from support.saturating import bobbin
from support.validation_cases import axis_field_of_cylinder

REMANENCE, RADIUS, HEIGHT, DISTANCE = 1.3, 0.0055, 0.005, 0.02


@pytest.fixture(scope="module")
def grid(tmp_path_factory):
    """Of a magnet alone: the weak coil that an assembly needs carries no current."""
    pyvista = pytest.importorskip("pyvista")
    file = tmp_path_factory.mktemp("vtu") / "field.vtu"
    actuator = assembly(moving=[magnet(REMANENCE, RADIUS, HEIGHT)], distances=(DISTANCE,))
    write_vtu(solve_point(actuator, DISTANCE, 0.0), file)
    return pyvista.read(file)


def test_the_paraview_file_holds_the_magnets_field_on_its_axis(grid):
    r, z, _ = grid.points.T
    on_axis = (np.abs(r) < 1e-12) & (z > DISTANCE - 0.02) & (z < DISTANCE - 1e-4)
    exact = [axis_field_of_cylinder(REMANENCE, RADIUS, HEIGHT, DISTANCE - height) for height in z[on_axis]]
    assert on_axis.sum() > 20
    # B at a point of one element is less exact than forces are: it jumps between elements by some 0.1 %
    np.testing.assert_allclose(grid["B"][on_axis, 1], exact, rtol=3e-3)
    np.testing.assert_allclose(grid["B"][on_axis, 0], 0.0, atol=1e-12)


def test_the_potential_in_the_paraview_file_gives_the_flux_through_a_disc(grid):
    """2 pi r A_phi at the rim is the flux of B_z through the disc: magpylib's exact B_z, by quadrature."""
    body = magpylib.magnet.Cylinder(
        polarization=(0, 0, REMANENCE), dimension=(2 * RADIUS, HEIGHT), position=(0, 0, DISTANCE + HEIGHT / 2)
    )
    nodes, weights = np.polynomial.legendre.leggauss(60)
    place, below = grid.points, grid.points[:, 1] < DISTANCE - 0.002
    for radius, z in ((0.004, 0.012), (0.01, 0.015), (0.02, 0.0)):
        k = np.argmin(np.where(below, np.hypot(place[:, 0] - radius, place[:, 1] - z), 1.0))
        rim, height, _ = place[k]
        r = 0.5 * rim * (nodes + 1.0)
        field = body.getB(np.stack([r, 0 * r, np.full_like(r, height)], axis=1))[:, 2]
        through = 0.5 * rim * np.sum(weights * 2.0 * np.pi * r * field)
        # The tolerance of the field solver's other points off the parts; the force is far better
        assert 2.0 * np.pi * rim * grid["A_phi"][k] == pytest.approx(through, rel=5e-4)
        assert grid["flux"][k] == pytest.approx(through, rel=5e-4)


def test_the_paraview_file_tells_parts_and_h_opposes_the_magnetisation_in_a_magnet(grid):
    """H = (B - B_r) / mu_0 in the magnet and B / mu_0 elsewhere."""
    fields, body = grid.point_data, grid["region"] == 1
    assert grid.points[body].max(axis=0)[:2] == pytest.approx([RADIUS, DISTANCE + HEIGHT])
    assert set(fields) == {"A_phi", "flux", "B", "H", "mu_r", "region"}
    np.testing.assert_allclose(fields["H"], (fields["B"] - body[:, None] * [0.0, REMANENCE, 0.0]) / MU_0, rtol=1e-9)
    assert np.median(fields["H"][body, 1]) < 0.0


def test_permeability_in_the_paraview_file_is_that_of_the_saturated_core(tmp_path):
    actuator = bobbin(distances=(0.005,), currents=(0.0, 12.0))
    write_vtu(solve_point(actuator, 0.005, 12.0), tmp_path / "field.vtu")
    cells = pytest.importorskip("pyvista").read(tmp_path / "field.vtu")
    steel = cells["region"] == 1 + [region.name for region in actuator.regions].index("sleeve")
    b, h = (np.linalg.norm(cells[name][steel], axis=1) for name in ("B", "H"))
    np.testing.assert_allclose(cells["mu_r"][steel], b / h / MU_0, rtol=1e-9)
    assert np.median(cells["mu_r"][steel]) < 200.0
    drawn = next(region.material for region in actuator.regions if region.name == "sleeve")
    np.testing.assert_allclose(h, BHCurve(drawn.flux_density_T, drawn.field_A_per_m).field(b), rtol=2e-3)


SWEPT, CURRENT = 0.0225, 0.8  # on the sweep's grid, away from where a mesh is made


@pytest.fixture(scope="module")
def actuator():
    return read_actuator(GEOMETRY / "emaws-rig.toml")


def test_flux_and_flux_density_belong_together(actuator):
    """B_z = (1 / 2 pi r) d psi/dr and B_r = -(1 / 2 pi r) d psi/dz, in the air between magnet and core."""
    sample = solve_point(actuator, SWEPT, CURRENT, SolverSettings(order=6)).sample
    r, z, psi = sample.radius_m, sample.height_m, sample.flux_Wb
    in_z, in_r = np.gradient(psi, z, r)
    gap = np.ix_((z > 0.005) & (z < 0.018), (r > 0.004) & (r < 0.02))
    magnitude = np.hypot(in_z, in_r)[gap] / (2.0 * np.pi * r[gap[1].ravel()])
    # |B| jumps between elements by up to 0.4 %; psi does not
    np.testing.assert_allclose(magnitude, sample.flux_density_T[gap], rtol=5e-3)


def test_no_flux_passes_through_the_axis_and_the_window_holds_every_part(actuator):
    sample = solve_point(actuator, SWEPT, CURRENT).sample
    np.testing.assert_array_equal(sample.flux_Wb[:, 0], 0.0)
    assert sample.radius_m[0] == 0.0
    assert sample.radius_m[-1] > 0.02
    assert sample.height_m[0] < -0.025 < SWEPT + 0.005 < sample.height_m[-1]
    assert 0.5 < sample.part_flux_density_T["magnet"] < 1.45  # below its remanence
    assert max(sample.part_flux_density_T[n] for n in ("sleeve", "upper_flange", "lower_flange")) < 0.5
