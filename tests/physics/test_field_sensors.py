"""Windings without current link Maxwell's mutual inductance."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import FieldSolverError
from femfit.device.electrics import PickupCoil
from femfit.device.load import read_actuator
from femfit.device.parts import Coil
from femfit.field.layout import layout_of
from femfit.field.pickup_coils import section_nodes
from femfit.field.problem import LinearActuator, NonlinearActuator
from femfit.field.tolerance import SolverSettings
from support.actuators import GEOMETRY, coil_on_a_magnet, device, magnet, rectangle, swept_at
from support.field import prepared
from support.validation_cases import loops_exact, thin_coil

SETTINGS = SolverSettings()


def winding(coil):
    return PickupCoil(name="search", vertices_m=coil.vertices_m, turns=coil.turns, moves=coil.moves)


def test_nodes_of_a_section_integrate_polynomials_exactly():
    # A triangle and a section with a step: the first moments of both in closed form.
    for corners, area, moment in (
        (((1.0, 0.0), (3.0, 0.0), (1.0, 3.0)), 3.0, 5.0),
        (((0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0)), 3.0, 2.5),
    ):
        points, weights = section_nodes(corners)
        assert weights.sum() == pytest.approx(area, rel=1e-14)
        assert weights @ points[:, 0] == pytest.approx(moment, rel=1e-14)


@pytest.mark.parametrize(("a", "b", "z"), [(0.1, 0.05, 0.05), (0.02, 0.015, 0.01)])
def test_a_loop_without_current_links_maxwells_mutual_inductance(a, b, z):
    search = winding(thin_coil(b, z))
    one = device(
        "loop",
        coils=[thin_coil(a)],
        moving=[magnet(0.0, 0.1 * a, 0.1 * a)],
        currents=((0.0, 1.0),),
        distances=(1.5 * z,),
        sensors=[search],
    )
    solution = prepared(one, 1.5 * z).solve(1.5 * z)
    assert solution.pickup["pickup_search_Wb"][1] == pytest.approx(loops_exact(a, b, z)[0], rel=1e-3)
    assert solution.pickup["pickup_search_Wb"][0] == 0.0


@pytest.mark.parametrize("moves", [False, True])
def test_a_pickup_coil_links_what_a_coil_in_its_place_links_while_the_mesh_stretches(moves):
    distances = (0.006, 0.008, 0.01)
    place = coil_on_a_magnet(distances).coils[int(moves)]
    actuator = coil_on_a_magnet(distances, [winding(place)])
    problem = LinearActuator(actuator, (0.006, 0.01), layout_of(actuator, SETTINGS), SETTINGS, estimate=False)
    for d in actuator.sweep.distances_m:
        solution = problem.solve(d)
        np.testing.assert_allclose(solution.pickup["pickup_search_Wb"], solution.flux_linkage[int(moves)], rtol=1e-6)


def test_in_saturating_iron_a_pickup_on_the_coil_links_a_share_of_its_turns():
    solenoid = swept_at(read_actuator(GEOMETRY / "solenoid.toml"), (2e-3,), (0.5, 1.5))
    (coil,) = solenoid.coils
    search = replace(winding(coil), turns=0.1 * coil.turns)
    with_search = replace(solenoid, sensors=(search,))
    coarse = SolverSettings(order=3)  # of both alike
    problem = NonlinearActuator(with_search, (2e-3,), layout_of(with_search, coarse), coarse, estimate=False)
    rows = problem.rows(2e-3, (0.5, 1.5))
    np.testing.assert_allclose(rows["pickup_search_Wb"], 0.1 * np.array(rows["flux_linkage_Wb"]), rtol=1e-6)


def test_a_pickup_coil_beyond_the_solved_field_is_refused_with_its_name():
    far = PickupCoil(name="far", vertices_m=rectangle(5.0, 5.1, 0.0, 0.1), turns=5.0)
    body = magnet(1.2, 0.007, 0.006, permeability=1.05)
    under = Coil(rectangle(0.008, 0.014, -0.02, -0.002), 200.0, 1.0)
    actuator = device("one", coils=[under], moving=[body], distances=(0.006,), sensors=[far])
    with pytest.raises(FieldSolverError, match="'far'"):
        prepared(actuator, 0.006).solve(0.006)
