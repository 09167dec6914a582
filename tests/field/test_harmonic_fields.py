"""Fields at a complex frequency: about a bias against the linear solver; plate, core, ball and sheets exactly."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit.core.numerics import MU_0
from femfit.device.load import actuator_from_toml
from femfit.device.parts import Region
from femfit.field.eddy_probe import EddyProbe
from femfit.field.harmonic import ConductorPoints
from femfit.field.point_rows import bias_currents
from femfit.field.source_fields import SourceFields
from support import eddy_cases as cases
from support import eddy_exact as exact
from support.actuators import rectangle
from support.eddy_cases import COPPER, STEEL
from support.eddy_transient import mesh_for
from support.small_drawing import POT

ORDER, DISTANCE, BIAS = 3, 1.5e-3, 0.4
STRAIGHT = f"B_T = [0, 1, 2]\nH_A_per_m = [0, {1 / (200 * MU_0)!r}, {2 / (200 * MU_0)!r}]\n"
BENT = "B_T = [0, 0.02, 0.04, 0.06, 0.1]\nH_A_per_m = [0, 20, 60, 300, 4000]\n"
UNSATURATED = "B_T = [0, 1, 2]\nH_A_per_m = [0, 1000, 2000]\n"  # as BENT in weak fields


def drawn(curve=None):
    text = POT if curve is None else POT.replace("relative_permeability = 200\n", curve)
    return actuator_from_toml(text.replace("eddy_error", f"eddy_bias_A = {BIAS}\neddy_error"))


@pytest.fixture(scope="module")
def both():
    """The pot of a linear material and of a straight curve, on one mesh."""
    linear = drawn()
    return linear, drawn(STRAIGHT), mesh_for(linear, DISTANCE, 100.0)


def forms(actuator, moving, bias):
    def loads(space):
        points = ConductorPoints(space, actuator, moving.reference)
        inside = np.where(points.moving_rows, 0.0, points.places[:, 0])
        outer = np.where(points.moving_rows, 1.0, points.places[:, 0] ** 2)
        rows = np.array([inside, outer])
        return points.loads(rows), points.loads(rows, moving=True)

    system = SourceFields(moving, actuator, ORDER, loads)
    system.bias = np.array([bias])
    with moving.at(DISTANCE):
        return system.evaluate()


def test_a_straight_curve_has_the_forms_of_the_linear_material(both):
    linear, curved, moving = both
    exact, found = (forms(one, moving, BIAS) for one in (linear, curved))
    at = np.array([1.0, BIAS, 0.0, 0.0])
    beside = exact.force @ at
    beside[0] = at @ exact.force @ at
    assert found.force[0] == pytest.approx(beside, rel=1e-6)
    assert not found.force[1:, 1:].any()
    linked = np.column_stack([exact.flux_linkage @ at, exact.flux_linkage[:, 1:]])
    assert found.flux_linkage == pytest.approx(linked, rel=1e-6, abs=1e-12)
    assert found.hall == pytest.approx([exact.hall @ at, *exact.hall[1:]], rel=1e-6)


def test_a_straight_curve_responds_like_the_linear_material_at_any_frequency(both):
    linear, curved, moving = both
    frequencies, shifts = np.array([10.0, 1000.0]), np.array([100.0])
    probes = [EddyProbe(one, moving, DISTANCE, ORDER, (BIAS,)) for one in (linear, curved)]
    (exact, fields), (found, others) = (one.transfers(frequencies) for one in probes)
    assert found.flux_linkage == pytest.approx(exact.flux_linkage, rel=1e-7)
    assert found.hall == pytest.approx(exact.hall, rel=1e-6)
    assert found.force[:, 0] == pytest.approx(np.array([1.0, BIAS]) @ exact.force, rel=1e-6)
    braking = np.array([1.0, BIAS]) @ probes[0].braking() @ np.array([1.0, BIAS])
    assert probes[1].braking()[0, 0] == pytest.approx(braking, rel=1e-4)
    patterns = [
        one.patterns(held, shifts, one.points, 0.01) for one, held in zip(probes, (fields, others), strict=True)
    ]
    assert all(len(one) > 2 for one in patterns)


def test_small_fields_are_the_derivatives_of_a_saturating_state(both):
    step, moving, bent = 1e-3, both[2], drawn(BENT)
    middle, below, above = (forms(bent, moving, one) for one in (BIAS, BIAS - step, BIAS + step))
    slope = (above.flux_linkage[:, 0] - below.flux_linkage[:, 0]) / (2.0 * step)
    assert middle.flux_linkage[:, 1] == pytest.approx(slope, rel=1e-4)
    assert middle.flux_linkage[1:, 1] == pytest.approx(middle.flux_linkage[0, 2:], rel=1e-7)  # reciprocity
    assert 2.0 * middle.force[0, 1] == pytest.approx((above.force - below.force)[0, 0] / (2.0 * step), rel=1e-4)
    weak = forms(drawn(UNSATURATED), moving, BIAS)
    assert middle.flux_linkage[0, 1] < 0.98 * weak.flux_linkage[0, 1]  # it does saturate


def test_the_bias_holds_the_flux_linkage_where_no_magnet_does(both):
    rows = pd.DataFrame(
        {
            "distance_m": np.repeat(both[1].sweep.distances_m, 3),
            "current_A": [0.0, 1.0, 2.0] * 4,
            "flux_linkage_Wb": [0.0, 4.0, 8.0, 0.0, 3.0, 6.0, 0.0, 2.0, 4.0, 0.0, 1.0, 2.0],
            "status": "ok",
        }
    )
    beside = replace(both[1], eddy_bias_A=())
    fixed = replace(beside, moving=replace(beside.moving, regions=beside.moving.regions[:1]))
    low, high = beside.sweep.currents_A[0], beside.sweep.currents_A[-1]
    assert set(bias_currents(beside, rows).values()) == {(0.5 * (low + high),)}
    assert [one for (one,) in bias_currents(fixed, rows).values()] == pytest.approx([4.0 / 3.0, 16.0 / 9.0, 2.0, 2.0])
    assert set(bias_currents(both[1], rows).values()) == {(BIAS,)}
    assert bias_currents(both[0], rows) == {}


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
