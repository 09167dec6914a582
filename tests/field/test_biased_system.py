"""Small fields about a bias, against the linear solver on a straight curve and differences on a bent one."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit.core.numerics import MU_0
from femfit.device.load import actuator_from_toml
from femfit.field.eddy_probe import EddyProbe
from femfit.field.eddy_sweep import induces
from femfit.field.harmonic import ConductorPoints
from femfit.field.point_rows import bias_currents
from femfit.field.source_fields import SourceFields
from femfit.field.sweep import run_sweep
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


@pytest.mark.nightly
def test_a_sweep_of_a_saturating_pot_gives_patterns_that_a_model_holds(tmp_path):
    text = POT.replace("relative_permeability = 200\n", BENT)
    text = text.replace("[1, 1.5, 2, 2.5]", "[1, 1.5]").replace("[-1, 0, 1]", "[0, 0.8]")
    text = text.replace("{ start = 10, stop = 1000, per_decade = 2 }", "[100, 200]")
    actuator = actuator_from_toml(text)
    assert induces(actuator)
    table = run_sweep(actuator, tmp_path, workers=1).eddy
    assert "0.40 A" in str(table)
    assert table.errors.max() < 0.02
    assert np.linalg.eigvalsh(table.flux_linkage[:, 1:, 2:]).min() > 0.0
