"""What a report says of a model: force at the supply, iron beside its knee, several circuits together."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from femfit.core.numerics import COPPER_TEMPERATURE_COEFFICIENT
from femfit.device.load import read_actuator
from femfit.device.materials import BHCurve
from femfit.device.mechanics import Stop
from femfit.device.parts import LinearMaterial, NonlinearMaterial
from femfit.fit.build import fit_model
from femfit.report.drawing import iron_loads, knee_T
from femfit.report.model_figures import at_supply, several_circuits, sweep_grid
from femfit.report.page import ReportContent, hangs, picture_point, strongest_point
from support.actuators import GEOMETRY
from support.bearing import ENTRY, Symmetric, table_of
from support.one_current import within

TRUTH = Symmetric()


def with_supply(model, **volts):
    return replace(model, circuits=(replace(model.circuit, **volts),))


def test_a_warm_coil_takes_less_current_at_the_same_voltage(plunger_content):
    model, heat = plunger_content.model, plunger_content.heat
    ohm = plunger_content.actuator.coil.resistance_ohm
    cold, warm = at_supply(model, heat)
    assert cold.current_A == pytest.approx(4.0 / ohm)
    assert (warm.temperature_C, warm.current_A) == pytest.approx((heat.windings_C[0], heat.currents_A[0]))
    unknown = at_supply(model)[1]
    assert unknown.current_A == pytest.approx(4.0 / (ohm * (1.0 + 80.0 * COPPER_TEMPERATURE_COEFFICIENT)))
    assert not at_supply(replace(model, circuits=()))


def test_forces_at_the_supply_end_at_the_stops_and_are_taken_within_the_model(plunger_content):
    weak = with_supply(plunger_content.model, voltage_max_V=40.0)
    motion = replace(weak.motion, near_stop=Stop(0.02), far_stop=Stop(0.04))
    cold = at_supply(replace(weak, motion=motion))[0]
    assert cold.limited
    assert cold.drawn_A == weak.validity.current_max_A
    assert tuple(cold.distance_m[[0, -1]]) == (0.02, 0.04)
    np.testing.assert_allclose(cold.force_N, weak.force(cold.distance_m, np.full(200, cold.drawn_A)))
    assert not at_supply(plunger_content.model)[0].limited
    drawn = replace(plunger_content.actuator.mechanics, near_stop=motion.near_stop)
    assert strongest_point(replace(plunger_content.actuator, mechanics=drawn))[0] == 0.02


def test_a_supply_of_both_signs_is_taken_at_the_one_that_attracts(rig_content):
    model = with_supply(rig_content.model, voltage_min_V=-3.0, voltage_max_V=3.0)
    assert at_supply(model)[0].voltage_V == 3.0
    either, repelled = within(model.validity, low=-1.4), lambda d, i: -0.1 * np.asarray(i) + 0.0 * d
    turned = SimpleNamespace(circuit=model.circuit, validity=either, travel_m=model.travel_m, force=repelled)
    assert at_supply(turned)[0].voltage_V == -3.0


def test_points_off_a_grid_are_not_arranged(rig_content):
    rows = rig_content.fit.rows
    grid = sweep_grid(rows)
    assert grid.force.shape == (len(rows.currents), len(rows.distances))
    assert sweep_grid(rows.take(np.arange(len(rows.force)) != 3)) is None


def test_beyond_the_knee_ten_per_cent_more_flux_density_take_half_more_field():
    actuator = read_actuator(GEOMETRY / "emaws-saturable.toml")
    steel = next(r.material for r in actuator.fixed if isinstance(r.material, NonlinearMaterial))
    knee, curve = knee_T(steel), BHCurve(steel.flux_density_T, steel.field_A_per_m)
    assert curve.field(1.1 * knee) / curve.field(knee) == pytest.approx(1.5, rel=5e-3)
    assert 0.2 < knee < 0.285  # the ferrite has 0.285 T at 2 kA/m
    assert knee_T(LinearMaterial("iron", 1000.0)) is None


def test_iron_is_judged_beside_its_own_knee_with_the_worst_part_first(plunger_content):
    actuator = read_actuator(GEOMETRY / "emaws-saturable.toml")
    loads = iron_loads(actuator, {"sleeve": 0.1, "upper_flange": 0.3, "lower_flange": 0.2})
    assert [load.region for load in loads] == ["upper_flange", "lower_flange", "sleeve"]
    assert loads[0].margin < 0.0 < loads[1].margin
    largest = {"plunger": 1.2, "shell": 0.4, "upper_plate": 1.6, "pole_and_bottom": 1.0}
    loads = [(load.region, load.margin) for load in iron_loads(plunger_content.actuator, largest)]
    # a linear material does not say where it saturates
    assert loads == [(name, None) for name in ("upper_plate", "plunger", "pole_and_bottom", "shell")]


def test_only_a_body_that_is_meant_to_hang_is_drawn_where_it_hangs(rig_content, plunger_content):
    hanging, standing = ((content, content.actuator, content.rows) for content in (rig_content, plunger_content))
    assert hangs(*hanging[1:])
    assert float(rig_content.model.force(*picture_point(*hanging))) == pytest.approx(rig_content.weight, rel=1e-6)
    assert not hangs(*standing[1:])
    assert picture_point(*standing) == strongest_point(plunger_content.actuator) == (0.0005, 1.0)


def test_a_bearings_numbers_are_those_of_its_closed_form_and_one_circuit_has_no_such_chapter(levitation_model):
    floating = {**ENTRY, "mechanics": {"gravity_m_s2": 0.0}}
    several = several_circuits(fit_model(table_of(TRUTH, entry=floating)).model)
    middle = len(several.distance_m) // 2
    force = several.grid.force[:, middle]
    np.testing.assert_allclose(several.along, [1.0, -1.0], rtol=1e-3)
    np.testing.assert_allclose(force, -force[::-1], atol=1e-3 * np.abs(force).max())  # of the fit
    np.testing.assert_allclose(several.bias_A, [1.0, 1.0])  # half of 2 A: without a magnet nothing holds at 0 A
    np.testing.assert_allclose(several.holding_A[middle], several.bias_A, rtol=1e-3)
    per_current = TRUTH.force_per_current(1.0)
    np.testing.assert_allclose(several.force_per_A[middle], [per_current, -per_current], rtol=5e-3)
    assert several.stiffness_N_per_m[middle] == pytest.approx(TRUTH.stiffness(1.0), rel=0.02)  # a second derivative
    assert ReportContent(levitation_model).together is None


def test_the_currents_that_hold_balance_the_weight():
    model = fit_model(table_of(TRUTH)).model  # it stands: 4.9 N pull it down
    several = several_circuits(model)
    force = model.magnetics.force(several.distance_m, several.holding_A)
    np.testing.assert_allclose(force, -9.81 * 0.5, rtol=1e-8)
