"""Force, flux linkage and co-energy against each other and against converged values of the paper's actuator."""

import dataclasses
from functools import cache

import numpy as np
import pytest
from numpy.polynomial import Chebyshev

from femfit.device.load import read_actuator
from femfit.device.parts import Coil, LinearMaterial, Region
from femfit.field.layout import layout_of
from femfit.field.linear_point import LinearActuator
from femfit.field.tolerance import SolverSettings
from support.actuators import GEOMETRY, assembly, magnet, rectangle
from support.field import in_current, prepared, solved

# Converged values of Table 1's actuator (30 turns): an independent run at order 6, corners graded to 0.03 mm, domain
# radius 2 m, stable to 0.01 %. Columns: distance in m, F_0 in N, F_1 in N/A, F_2 in N/A^2, magnet's field in T.
CONVERGED = (
    (0.015, 0.0803275, 0.0110974, 1.474e-7, 0.018054),
    (0.020, 0.0261666, 0.0085470, 8.648e-8, 0.0086864),
    (0.030, 0.0045700, 0.0046488, 2.745e-8, 0.0028688),
    (0.040, 0.0011833, 0.0025463, 9.18e-9, 0.0012600),
)
CHEBYSHEV_NODES = 12


@cache
def paper_actuator():
    return read_actuator(GEOMETRY / "emaws.toml")


@cache
def solution_at_chebyshev_nodes():
    """Coefficients of one stretched mesh at Chebyshev nodes of 15..25 mm: everything is analytic in d."""
    actuator, settings = paper_actuator(), SolverSettings()
    low, high = 0.015, 0.025
    nodes = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(
        np.pi * (np.arange(CHEBYSHEV_NODES) + 0.5) / CHEBYSHEV_NODES
    )
    problem = LinearActuator(actuator, (low, high), layout_of(actuator, settings), settings)
    return nodes, [in_current(problem.solve(float(d))) for d in nodes]


def chebyshev(values, nodes):
    return Chebyshev.fit(nodes, values, CHEBYSHEV_NODES - 1, domain=[0.015, 0.025])


@pytest.mark.parametrize("row", CONVERGED, ids=lambda row: f"{1e3 * row[0]:g} mm")
def test_converged_values_of_the_papers_actuator_are_met(row):
    distance, *force, field = row
    solution = solved(paper_actuator(), distance)
    # The required 0.1 %; the solver does better than 0.01 % but F_2 is printed with three digits only.
    np.testing.assert_allclose(solution.force, force, rtol=1e-3)
    assert solution.hall[0] == pytest.approx(field, rel=1e-3)
    assert solution.flux_linkage[1] / 30.0**2 == pytest.approx(1.71197e-7, rel=1e-3)


def test_rig_has_the_papers_electrical_constants():
    actuator = read_actuator(GEOMETRY / "emaws-rig.toml")
    solution = solved(actuator, 0.022)
    assert solution.flux_linkage[1] == pytest.approx(1.0 / 61.61, rel=0.01)  # (32): 1/L = 61.61 1/H
    assert actuator.coil.resistance_ohm == pytest.approx(165.6 / 61.61, rel=0.01)
    weight = actuator.mechanics.mass_kg * 9.80665
    for distance, voltage in ((0.022, 0.87), (0.030, 2.15), (0.032, 2.5)):
        f0, f1, f2 = solved(actuator, distance).force
        current = (weight - f0) / f1  # F_2 is negligible
        assert abs(f2) * current**2 < 1e-3 * weight
        assert current * actuator.coil.resistance_ohm == pytest.approx(voltage, rel=0.02)


def test_virtual_work_gives_the_stress_tensors_force():
    # F = -dW'/dd at zero current; the plunger below does it for the coil's own term, which is 1e-5 of the force here.
    nodes, solutions = solution_at_chebyshev_nodes()
    inner = (nodes > 0.0152) & (nodes < 0.0248)  # derivatives of the interpolant lose digits at the very ends
    force = -chebyshev([s.coenergy for s in solutions], nodes).deriv()(nodes[inner])
    np.testing.assert_allclose(force, np.array([s.force[0] for s in solutions])[inner], rtol=5e-4)


def test_reciprocity_holds():
    # dF/di = -d(flux linkage)/dd at zero current: F_1 against the magnet's flux in the coil.
    nodes, solutions = solution_at_chebyshev_nodes()
    inner = (nodes > 0.0152) & (nodes < 0.0248)
    slope = -chebyshev([s.flux_linkage[0] for s in solutions], nodes).deriv()(nodes[inner])
    np.testing.assert_allclose(slope, np.array([s.force[1] for s in solutions])[inner], rtol=3e-4)


def test_force_is_smooth_on_a_stretched_mesh():
    # A polynomial through 12 nodes predicts points between them: no remeshing jump, F(d) is analytic.
    nodes, solutions = solution_at_chebyshev_nodes()
    curve = chebyshev([s.force[0] for s in solutions], nodes)
    settings, actuator = SolverSettings(), paper_actuator()
    problem = LinearActuator(actuator, (0.015, 0.025), layout_of(actuator, settings), settings)
    for distance in (0.0163, 0.0201, 0.0237):
        assert in_current(problem.solve(distance)).force[0] == pytest.approx(curve(distance), rel=1e-6)


def test_stretching_a_mesh_gives_what_a_new_mesh_gives():
    actuator, settings = paper_actuator(), SolverSettings()
    layout = layout_of(actuator, settings)
    stretched = in_current(LinearActuator(actuator, (0.015, 0.03), layout, settings).solve(0.028))
    fresh = in_current(LinearActuator(actuator, (0.028,), layout, settings).solve(0.028))
    np.testing.assert_allclose(stretched.force[:2], fresh.force[:2], rtol=3e-4)
    np.testing.assert_allclose(stretched.flux_linkage, fresh.flux_linkage, rtol=3e-4)


def test_open_boundary_costs_no_accuracy():
    # At the largest distance, where the far field counts most: a tenth of the error that the row itself states.
    actuator = paper_actuator()
    near = solved(actuator, 0.045)
    far = solved(actuator, 0.045, dataclasses.replace(SolverSettings(), outer_radius_factor=64.0))
    np.testing.assert_allclose(near.force[:2], far.force[:2], rtol=2e-5)


def test_self_force_of_a_magnet_alone_is_removed_entirely():
    solution = solved(assembly(moving=[magnet(1.45, 0.0055, 0.005, permeability=1.05)], distances=(0.02,)))
    assert abs(solution.force[0]) < 1e-12


def test_uncorrected_stress_is_wrong_on_a_coarse_mesh_and_the_corrected_is_not():
    coarse = SolverSettings(order=2, corner_fraction=0.3)
    fine = solved(paper_actuator(), 0.04).force[0]
    solution = solved(paper_actuator(), 0.04, coarse)
    assert abs(solution.self_force[0]) > 0.05 * fine
    assert solution.force[0] == pytest.approx(fine, rel=0.02)


def test_larger_geometry_scales_force_with_area_and_field_not_at_all():
    actuator = assembly(
        fixed=[Region("iron", rectangle(0.0, 0.01, -0.02, -0.001), LinearMaterial("iron", 450.0))],
        moving=[magnet(1.3, 0.005, 0.005)],
        distances=(0.01,),
        coil=rectangle(0.011, 0.02, -0.02, -0.005),
        turns=100,
        hall=(0.0, 0.0),
    )
    twice = scaled(actuator, 2.0)
    small, large = solved(actuator), solved(twice)
    np.testing.assert_allclose(large.force, small.force * np.array([4.0, 2.0, 1.0]), rtol=2e-5, atol=1e-12)
    np.testing.assert_allclose(large.flux_linkage, small.flux_linkage * np.array([4.0, 2.0]), rtol=2e-5)
    np.testing.assert_allclose(large.hall, small.hall * np.array([1.0, 0.5]), rtol=2e-5)


def scaled(actuator, factor):
    """The same drawing, every length multiplied."""

    def grow(vertices):
        return tuple((factor * r, factor * z) for r, z in vertices)

    def regions(group):
        return tuple(dataclasses.replace(region, vertices_m=grow(region.vertices_m)) for region in group)

    hall = dataclasses.replace(
        actuator.hall, radius_m=factor * actuator.hall.radius_m, height_m=factor * actuator.hall.height_m
    )
    return dataclasses.replace(
        actuator,
        fixed=regions(actuator.fixed),
        coils=(Coil(grow(actuator.coil.vertices_m), actuator.coil.turns, 1.0),),
        moving=dataclasses.replace(actuator.moving, regions=regions(actuator.moving.regions)),
        sweep=dataclasses.replace(actuator.sweep, distances_m=tuple(factor * d for d in actuator.sweep.distances_m)),
        sensors=(hall,),
    )


def test_reversed_magnet_and_current_give_the_same_force():
    actuator = paper_actuator()
    body = actuator.moving.regions[0]
    turned = dataclasses.replace(
        body, material=dataclasses.replace(body.material, remanence_T=-body.material.remanence_T)
    )
    reverse = dataclasses.replace(actuator, moving=dataclasses.replace(actuator.moving, regions=(turned,)))
    plain, reversed_ = solved(actuator, 0.02).force, solved(reverse, 0.02).force
    np.testing.assert_allclose(reversed_, plain * np.array([1.0, -1.0, 1.0]), rtol=1e-12)


def test_turns_scale_force_and_inductance():
    thirty, rig = solved(paper_actuator(), 0.02), solved(read_actuator(GEOMETRY / "emaws-rig.toml"), 0.02)
    ratio = 308.0 / 30.0
    np.testing.assert_allclose(rig.force, thirty.force * ratio ** np.arange(3), rtol=1e-9)
    np.testing.assert_allclose(rig.flux_linkage, thirty.flux_linkage * ratio ** np.arange(1, 3), rtol=1e-9)


def test_plunger_is_pulled_with_the_square_of_the_current():
    actuator = read_actuator(GEOMETRY / "plunger-solenoid.toml")
    solution = solved(actuator, 0.005)
    assert solution.force[0] == 0.0
    assert solution.force[1] == 0.0
    assert solution.force[2] > 0.0
    assert prepared(actuator, 0.005).layout.stretchable is False
