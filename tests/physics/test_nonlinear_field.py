"""The field of saturating parts against a closed form, the linear solver, energy and another solver's table."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from femfit.core.numerics import MU_0
from femfit.device.materials import BHCurve
from femfit.device.parts import LinearMaterial, Region
from femfit.field.layout import layout_of
from femfit.field.newton import minimise
from femfit.field.problem import LinearActuator
from femfit.field.tolerance import SolverSettings
from support.actuators import assembly, magnet, rectangle, swept_at
from support.field import prepared
from support.saturating import STEEL, bobbin, rig_with_core, rows_at, straight

TURNS, LENGTH, ROD, INNER, OUTER = 100.0, 0.04, 0.005, 0.007, 0.012


def closed_pot(currents):
    """A steel rod in a coil that fills a pot of (nearly) infinite permeability: H = N i / length in the whole rod."""
    yoke = LinearMaterial("yoke", 1e9)
    low, high = -0.05, -0.01
    fixed = [
        Region("rod", rectangle(0.0, ROD, low, high), STEEL),
        Region("lower", rectangle(0.0, OUTER + 0.01, low - 0.01, low), yoke),
        Region("upper", rectangle(0.0, OUTER + 0.01, high, 0.0), yoke),
        Region("shell", rectangle(OUTER, OUTER + 0.01, low, high), yoke),
    ]
    coil = rectangle(INNER, OUTER, low, high)
    body = magnet(0.0, 0.002, 0.002, permeability=1.0)
    actuator = assembly(fixed=fixed, moving=[body], distances=(0.02,), coil=coil, turns=TURNS)
    return swept_at(actuator, currents=currents)


def pot_flux_linkage(current):
    """N x flux: the rod's, the air's between rod and coil, and the coil's own, where H falls linearly with r."""
    curve = BHCurve(STEEL.flux_density_T, STEEL.field_A_per_m)
    h = TURNS * current / LENGTH
    b = brentq(lambda x: float(curve.field(np.array([x]))[0]) - h, 0.0, 5.0, xtol=1e-15)
    through = b * math.pi * ROD**2 + MU_0 * h * math.pi * (INNER**2 - ROD**2)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    r = INNER + 0.5 * (OUTER - INNER) * (nodes + 1.0)
    share = (OUTER - r) / (OUTER - INNER)  # of the turns outside of r, which make H there; their flux links the same
    in_coil = 0.5 * (OUTER - INNER) * np.sum(weights * share**2 * 2.0 * math.pi * r) * MU_0 * h
    return TURNS * (through + in_coil)


# In the winding w holds 1 / r^2, which polynomials approach only: 1e-5 of the flux with elements of a quarter of it.
SMALL = SolverSettings(region_fraction=0.25)


@pytest.fixture(scope="module")
def pot():
    """Rows of the closed pot from 250 A/m to 500 kA/m, 0.6 to 2.7 T."""
    currents = (0.0, 0.1, 0.5, 4.0, 200.0)
    rows = rows_at(closed_pot(currents), settings=SMALL)
    assert (rows["status"] == "ok").all()
    return np.array(currents), rows


def test_flux_of_a_closed_core_is_that_of_the_magnetisation_curve(pot):
    currents, rows = pot
    wanted = [pot_flux_linkage(i) for i in currents[1:]]
    np.testing.assert_allclose(rows["flux_linkage_Wb"][1:], wanted, rtol=1e-5)


def test_inductance_and_coenergy_of_a_closed_core_are_derivative_and_integral_of_its_flux(pot):
    chosen = [0, 1, 2, 3]
    currents, rows = pot[0][chosen], {name: np.asarray(values)[chosen] for name, values in pot[1].items()}
    step = 1e-4
    slope = [
        (pot_flux_linkage(i * (1 + step)) - pot_flux_linkage(i * (1 - step))) / (2 * step * i) for i in currents[1:]
    ]
    np.testing.assert_allclose(
        rows["inductance_H"][1:], slope, rtol=1e-4
    )  # the points of the curve are kinks of its slope's slope
    nodes, weights = np.polynomial.legendre.leggauss(400)
    integral = [
        0.5 * i * np.sum(weights * [pot_flux_linkage(0.5 * i * (x + 1.0)) for x in nodes]) for i in currents[1:]
    ]
    np.testing.assert_allclose(rows["coenergy_J"][1:] - rows["coenergy_J"][0], integral, rtol=2e-5)


def test_a_straight_magnetisation_curve_gives_the_linear_solvers_rows():
    permeability, distances = 450.0, (0.018, 0.02, 0.021)  # one group: from the reference distance, on a stretched mesh
    actuator = rig_with_core(straight(permeability), distances)
    linear = rig_with_core(LinearMaterial("linear", permeability), distances)
    problem = LinearActuator(linear, distances, layout_of(linear, SolverSettings()), SolverSettings())
    expected = problem.rows(0.018, linear.sweep.currents_A)
    rows = rows_at(actuator, 0.018)
    for column in ("force_N", "flux_linkage_Wb", "inductance_H", "coenergy_J", "hall_T"):
        np.testing.assert_allclose(rows[column], expected[column], rtol=1e-8, atol=1e-12)


def test_newtons_iteration_converges_quadratically():
    problem = prepared(bobbin(), 0.005)
    system = problem.fine
    system.move()
    near = minimise(system, np.array([4.0]), np.zeros(system.space.ndof)).state
    result = minimise(system, np.array([5.0]), near, renewal_cost=0.0)
    assert result.converged
    # From one correction to the next r -> C r^2: close to the solution the digits double.
    tail = [r for r in result.history if r < 3e-3]
    orders = np.diff(np.log(tail))[1:] / np.diff(np.log(tail))[:-1]
    assert len(tail) >= 3
    assert max(orders) > 1.7


def test_self_force_of_a_magnet_with_a_steel_back_alone_is_removed_entirely():
    """The magnet saturates its disc of steel in part: permanent and induced magnetisation."""
    back = Region("back", rectangle(0.0, 0.0055, 0.003, 0.004), STEEL)
    body = [magnet(1.3, 0.0055, 0.003, permeability=1.05), back]
    rough = SolverSettings(order=2, corner_fraction=0.5, region_fraction=1.0, grading=0.5)
    assert abs(rows_at(assembly(moving=body, distances=(0.015,)), settings=rough)["force_N"][0]) < 1e-9
