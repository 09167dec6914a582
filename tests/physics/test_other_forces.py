"""The force on the mover against the reaction on the fixed parts and against virtual work."""

import ngsolve as ng
import numpy as np
import pytest
from numpy.polynomial import Chebyshev

from femfit.device.load import read_actuator
from femfit.field.layout import FIXED, MOVING, layout_of
from femfit.field.point_rows import DISAGREEMENT, DistanceSolution, sources, superpose
from femfit.field.problem import LinearActuator
from femfit.field.tolerance import LevelChoice, SolverSettings, ToleranceProblem
from femfit.field.weak_form import AROUND_FIXED, LayerForce, quadratic
from support.actuators import GEOMETRY
from support.field import coefficients, in_current, prepared
from support.saturating import bobbin

LOW, HIGH, NODES = 0.018, 0.024, 14


def test_virtual_work_is_the_slope_of_the_fields_mutual_coenergy():
    # W' = W_0 + flux_0 i + L i^2 / 2. On one stretched mesh its slope is the stress weighted by the stretch, an
    # identity of the discrete fields; virtual work leaves out the own energies' slopes, which the stress of each has.
    rig = read_actuator(GEOMETRY / "emaws-rig.toml")
    settings = SolverSettings(order=4)
    problem = LinearActuator(rig, (LOW, HIGH), layout_of(rig, settings), settings, estimate=False)
    nodes = 0.5 * (LOW + HIGH) + 0.5 * (HIGH - LOW) * np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
    energies, works = [], []
    for d in nodes:
        solution = in_current(problem.solve(float(d)))
        energies.append((solution.coenergy, solution.flux_linkage[0], 0.5 * solution.flux_linkage[1]))
        works.append(solution.work + own_stresses(problem, float(d)))
    inner = (nodes > LOW + 3e-4) & (nodes < HIGH - 3e-4)  # derivatives of the interpolant lose digits at the very ends
    for k, rtol in enumerate((1e-6, 1e-6, 1e-4)):  # L changes by 1e-7 of itself in a millimetre
        curve = Chebyshev.fit(nodes, np.array(energies)[:, k], NODES - 1, domain=[LOW, HIGH])
        np.testing.assert_allclose(-curve.deriv()(nodes[inner]), np.array(works)[inner, k], rtol=rtol)


def own_stresses(problem, distance):
    """Coefficients of T(u, u) + T(v, v) at the distance that was solved last."""
    system = problem._system
    others = [ng.GridFunction(system.space) for _ in system.total]
    for other, total, own in zip(others, system.total, system.own, strict=True):
        other.vec.data = total.vec - own.vec
    with problem._moving.at(distance):
        stress = LayerForce(system.space, problem._moving.work_weight, AROUND_FIXED)
    return coefficients(quadratic(stress, system.own) + quadratic(stress, others))


def test_the_layer_moves_as_one_also_round_a_part_with_a_pointed_end():
    actuator = read_actuator(GEOMETRY / "biased-electromagnet.toml")  # its body tapers towards the axis
    problem = prepared(actuator, 0.005, SolverSettings(order=3))
    slope = ng.grad(problem._moving.work_weight)
    still = problem.mesh.Materials(f"layer|halo|{MOVING}|{FIXED}")
    assert ng.Integrate(slope * slope, problem.mesh, definedon=still) < 1e-20


@pytest.mark.parametrize(
    ("name", "distance"), [("emaws-rig", 0.022), ("plunger-solenoid", 0.0055), ("biased-electromagnet", 0.0155)]
)
def test_force_reaction_and_virtual_work_agree_where_the_plain_reaction_does_not(name, distance):
    actuator = read_actuator(GEOMETRY / f"{name}.toml")
    problem = prepared(actuator, distance)
    solution, current = in_current(problem.solve(distance)), actuator.sweep.currents_A[-1]
    powers = np.array([1.0, current, current**2])
    force, reaction, work = (powers @ one for one in (solution.force, solution.reaction, solution.work))
    plain = LayerForce(problem._system.space, problem._moving.reaction_weight, AROUND_FIXED)
    field = problem.field(distance, current).w
    # Both share the magnetisation, and with the fields' own stresses left out nothing else: 1e-8 to 3e-7 were found.
    assert [reaction, work] == pytest.approx([force] * 2, rel=2e-6)
    assert abs(plain.between(field, field) - force) > 20.0 * abs(reaction - force)


def test_force_on_a_steel_plunger_the_reaction_and_virtual_work_agree_when_it_saturates():
    solution = prepared(bobbin(), 0.005).solve(0.005, (8.0,))[0].solution
    assert [solution.reaction, solution.work] == pytest.approx([solution.force] * 2, rel=2e-6)


def solution_of(force, change, reaction, work):
    matrices = ([[a, b / 2.0], [b / 2.0, c]] for a, b, c in (force, change, reaction, work))
    names = ("force", "force_change", "reaction", "work")
    arrays = {name: np.array(matrix, dtype=float) for name, matrix in zip(names, matrices, strict=True)}
    nothing = np.zeros((2, 2))
    return DistanceSolution(**arrays, flux_linkage=np.ones((1, 2)), coenergy=0.0, hall=None, self_force=nothing)


@pytest.mark.parametrize(("reaction", "work"), [((1.5, 1.0, 0.0), (1.0, 1.0, 0.0)), ((1.0, 1.0, 0.0), (0.5, 1.0, 0.0))])
def test_the_stated_error_is_the_larger_of_change_and_disagreement(reaction, work):
    rows = superpose(
        sources((0.0, 2.0), ("coil",)), solution_of((1.0, 1.0, 0.0), (0.1, -0.1, 0.0), reaction, work), ("coil",)
    )
    np.testing.assert_allclose(rows[DISAGREEMENT], [0.5, 0.5])
    np.testing.assert_allclose(rows["force_error_N"], [0.5, 0.9])


class _Level:
    mesh = unknowns = field = signatures = None

    def rows(self, _distance, _currents):
        return {"force_N": [2.0, 4.0], DISAGREEMENT: [0.5, 0.1]}


def test_a_row_solved_to_a_tolerance_states_the_disagreement_where_it_is_larger():
    problem = ToleranceProblem(_Level(), SolverSettings(), LevelChoice(1, ((0.0,), (1.0,)), (0.1, 0.1)))
    assert problem.rows(0.01, (0.0, 1.0))["force_error_N"] == [0.5, 0.4]
