"""The field at a complex frequency against closed forms: plate, rod, core, ball and sheets; energy and reciprocity."""

import math

import numpy as np
import pytest

from femfit.core.numerics import MU_0
from femfit.device.parts import Region
from support import eddy_cases as cases
from support import eddy_exact as exact
from support.actuators import rectangle
from support.eddy_cases import COPPER, STEEL

LAYERS = 1e-3
"""Relative error of the impedance with order 4 and skin layers; the elements along a surface take part in it."""

BODIES = pytest.mark.parametrize("body", [COPPER, STEEL], ids=["copper", "steel"])


def omega(frequency):
    return 2j * math.pi * frequency


def difference(ours, reference):
    return abs(ours / reference - 1.0)


def departure(case, body, s):
    return difference(case.counted(case.case, body, s, order=4), case.exact(s, body))


@pytest.mark.parametrize("thickness", [1e-3, 2e-5])
def test_coil_above_a_thin_sheet_is_exact_with_few_unknowns(thickness):
    # At lower frequencies the field goes through them, and the edge at five times the coil's radius takes part.
    s = omega(1e5)
    harmonic = cases.Harmonic(cases.plate(COPPER, thickness=thickness), 1e5, order=4)
    found, fields = harmonic.solve(s)
    alone = cases.inductance(cases.plate(cases.VACUUM), 1.0, order=4)
    reference = exact.above_plate(s, COPPER, cases.PLATE_COIL, 100.0, thickness)
    assert difference(found[0, 0] - alone, reference) < LAYERS
    assert fields[0].space.ndof < 20_000


@pytest.mark.parametrize("case", [cases.CORE_CASE, cases.BALL_CASE], ids=["core", "ball"])
@BODIES
@pytest.mark.parametrize("s", [1e2, 1e6])
def test_fields_at_real_frequencies_are_exact_too(case, body, s):
    assert departure(case, body, s) < LAYERS


@pytest.mark.nightly
@pytest.mark.parametrize("case", [cases.PLATE_CASE, cases.BALL_CASE], ids=["plate", "ball"])
@BODIES
def test_no_frequency_falls_between_two_layers(case, body):
    assert max(departure(case, body, s) for s in omega(np.geomspace(1e3, 1e5, 17))) < LAYERS


SHEETS, THICKNESS = (2e6, 1000.0), 0.35e-3


@pytest.mark.parametrize("frequency", [50.0, 5000.0])
def test_sheets_are_those_of_the_first_term(frequency):
    # nu (1 + x^2 / 12): the magnetomotive force of the ideal iron, 1e-5 beside a core of mu_r 1000, is what is left.
    s = omega(frequency)
    term = s * MU_0 * SHEETS[0] * SHEETS[1] * THICKNESS**2 / 12.0
    found = cases.inductance(cases.core(SHEETS, THICKNESS), s, order=4)
    assert difference(found, cases.core_exact(s, SHEETS, 1.0 / (1.0 + term))) < 2e-5


def homogenisation_error(thickness_over_depth):
    """Of the impedance of a coil around a stack of sheets."""
    s = omega(thickness_over_depth**2 / (math.pi * MU_0 * SHEETS[0] * SHEETS[1] * THICKNESS**2))
    reference = cases.core_exact(s, SHEETS, exact.sheet_ratio(s, SHEETS, THICKNESS))
    return difference(cases.inductance(cases.core(SHEETS, THICKNESS), s, order=4), reference)


def test_first_term_of_sheets_leaves_1_percent_where_they_are_thicker_than_the_skin_depth():
    # (x / 2) coth(x / 2) = 1 + x^2 / 12 - x^4 / 720, |x| = sqrt(2) b / depth: an error of (b / depth)^4 / 180.
    assert homogenisation_error(0.5) == pytest.approx(0.5**4 / 180.0, rel=0.1)
    assert homogenisation_error(1.0) == pytest.approx(1.0 / 180.0, rel=0.1)
    assert homogenisation_error(1.1) < 0.01 < homogenisation_error(1.25)


def two_circuits():
    plate = Region("plate", rectangle(0.0, 0.03, -0.01, 0.0), cases.material(COPPER))
    ring = Region("ring", rectangle(0.012, 0.02, 0.008, 0.012), cases.material(STEEL))
    stack = Region("stack", rectangle(0.0, 0.006, 0.001, 0.02), cases.material(SHEETS, THICKNESS, "sheets"))
    return cases.drawing([plate, ring, stack], [(0.008, 0.011, 0.002, 0.01), (0.022, 0.026, 0.002, 0.02)])


@pytest.mark.parametrize("frequency", [50.0, 2e4])
def test_resistance_is_the_loss_and_two_circuits_are_reciprocal(frequency):
    s = omega(frequency)
    harmonic = cases.Harmonic(two_circuits(), frequency, order=4)
    found, fields = harmonic.solve(s)
    assert found[0, 1] == pytest.approx(found[1, 0], rel=1e-11)
    for k in range(2):
        assert (s * found[k, k]).real == pytest.approx(cases.loss(harmonic, s, fields[k]), rel=1e-7)
    both = (s * found).real
    assert np.all(np.linalg.eigvalsh(0.5 * (both + both.T)) > 0.0)
