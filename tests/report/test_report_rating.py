"""What coil and iron allow follows from resistance, heat and the B-H curve."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from femfit.audit.carried import carried_range
from femfit.core.numerics import COPPER_TEMPERATURE_COEFFICIENT
from femfit.device.bh import BHCurve
from femfit.device.load import read_actuator
from femfit.device.mechanics import Stop
from femfit.device.parts import LinearMaterial, NonlinearMaterial
from femfit.report.page import levitates, picture_point, strongest_point
from femfit.report.rating import copper_share, growth, iron_loads, knee_T, rate, sweep_grid
from support.actuators import GEOMETRY
from support.one_current import within


@pytest.fixture(scope="module")
def rating(plunger_content):
    return rate(plunger_content.model, plunger_content.actuator, heat=plunger_content.heat)


def test_a_warm_coil_takes_less_current_at_the_same_voltage(rating, plunger_content):
    ohm = plunger_content.actuator.coil.resistance_ohm
    cold, warm = rating.feed("cold"), rating.feed("warm")
    settled = plunger_content.heat
    assert cold.current_A == pytest.approx(4.0 / ohm)
    assert (warm.temperature_C, warm.current_A) == pytest.approx((settled.windings_C[0], settled.currents_A[0]))
    unknown = rate(plunger_content.model, plunger_content.actuator).feed("warm")
    assert unknown.current_A == pytest.approx(4.0 / (ohm * (1.0 + 80.0 * COPPER_TEMPERATURE_COEFFICIENT)))
    assert warm.power_W == pytest.approx(4.0 * warm.current_A)


def test_the_rated_current_brings_the_hottest_strand_to_its_limit(rating, plunger_content):
    rated, heat = rating.feed("rated"), plunger_content.heat
    assert heat.at_limit.hottest_C[0] == pytest.approx(130.0, abs=1e-3)
    assert rated.current_A == pytest.approx(heat.allowed_A[0])
    assert rated.temperature_C == pytest.approx(heat.at_limit.windings_C[0])
    assert rated.power_W == pytest.approx(heat.at_limit.heat_W.sum(), rel=1e-6)
    area = 0.25 * np.pi * 0.45**2
    assert rated.density_A_mm2 == pytest.approx(rated.current_A / area)


def test_forces_beyond_the_models_current_are_taken_at_its_end_and_said_to_be(rating, plunger_content):
    assert not rating.feed("cold").limited
    weak = replace(plunger_content.model, circuits=(replace(plunger_content.model.circuit, voltage_max_V=40.0),))
    cold = rate(weak, plunger_content.actuator).feed("cold")
    assert cold.limited
    assert cold.drawn_A == weak.validity.current_max_A
    assert cold.force_near_N == pytest.approx(float(weak.force(weak.validity.distance_min_m, cold.drawn_A)))


def stopped(content, near=0.02, far=0.04):
    """The same device between two stops within its sweep."""
    motion = replace(content.model.motion, near_stop=Stop(near), far_stop=Stop(far))
    drawn = replace(content.actuator, mechanics=replace(content.actuator.mechanics, near_stop=motion.near_stop))
    return replace(content, model=replace(content.model, motion=motion), actuator=drawn)


def test_what_is_said_of_a_device_ends_at_its_stops_and_not_with_the_sweep(plunger_content, rig_content):
    content = stopped(plunger_content)
    rated = rate(content.model, content.actuator)
    cold = rated.feed("cold")
    assert cold.force_near_N == pytest.approx(float(content.model.force(0.02, cold.drawn_A)))
    assert cold.force_far_N == pytest.approx(float(content.model.force(0.04, cold.drawn_A)))
    assert (rated.distance_m[0], rated.distance_m[-1]) == (0.02, 0.04)
    assert growth(content.model, content.model.validity.current_max_A).distance_m == 0.02
    assert strongest_point(content.actuator)[0] == 0.02
    free, held = carried_range(rig_content.model), carried_range(stopped(rig_content, near=0.02).model)
    assert free.low_m < 0.02 <= held.low_m


def test_the_motor_constant_is_the_slope_of_the_force_over_the_root_of_the_resistance(rating, plunger_content):
    model, current, step = plunger_content.model, rating.reference.drawn_A, 1e-4
    d = rating.distance_m[40]
    slope = (model.force(d, current) - model.force(d, current - step)) / step
    assert rating.motor_constant[40] == pytest.approx(slope / np.sqrt(rating.cold_ohm), rel=1e-3)


def test_the_time_constant_is_that_of_coil_and_what_is_in_series(rig_content):
    choke = replace(rig_content.model, circuits=(replace(rig_content.model.circuit, inductance_H=0.05),))
    without, with_it = rate(rig_content.model, None), rate(choke, None)
    longer = with_it.time_constant_s(with_it.inductance_H) - without.time_constant_s(without.inductance_H)
    np.testing.assert_allclose(longer, 0.05 / without.cold_ohm)


def test_a_device_is_rated_with_what_it_is_fed_with(rig_content, rating):
    assert rating.feed("idle") is None
    idle = rate(rig_content.model, rig_content.actuator).feed("idle")
    assert idle.force_near_N == pytest.approx(float(rig_content.model.force(0.015, 0.0)))
    rating = rate(rig_content.model, None)
    assert rating.feed("rated") is None
    assert rating.reference.name == "warm"
    assert rate(replace(rig_content.model, circuits=()), None) is None


def test_a_force_in_proportion_to_the_current_is_not_said_to_be_limited_by_saturation(rig_content, plunger_content):
    for content in (rig_content, plunger_content):  # F = a + b i and F = c i^2
        grown = growth(content.model, content.model.validity.current_max_A)
        assert grown.gained_N == pytest.approx(grown.expected_N, rel=0.02)
        assert not grown.limited
    box = rig_content.model.validity
    flat = SimpleNamespace(
        force=lambda d, i: np.tanh(2.0 * i) + 0.0 * d, has_magnet=True, validity=box, travel_m=(0.015, 0.045)
    )
    assert growth(flat, box.current_max_A).limited
    assert growth(replace(rig_content.model, validity=within(box, low=1.3)), 1.4) is None


def test_a_supply_of_both_signs_is_rated_at_the_one_that_attracts(rig_content):
    model = replace(
        rig_content.model, circuits=(replace(rig_content.model.circuit, voltage_min_V=-3.0, voltage_max_V=3.0),)
    )
    assert rate(model, None).voltage_V == 3.0
    box = within(model.validity, low=-1.4)
    turned = SimpleNamespace(
        circuit=model.circuit, validity=box, has_magnet=True, inductance=lambda d, i: 0.0 * d,
        magnetics=model.magnetics, travel_m=model.travel_m,
        force=lambda d, i: -0.1 * np.asarray(i) + 0.0 * d,
    )  # fmt: skip
    assert rate(turned, None).voltage_V == -3.0


def test_forces_at_the_swept_currents_are_those_of_the_sweep(rig_content):
    grid = sweep_grid(rig_content.rows)
    off = replace(grid, force=1.04 * grid.force)  # a model that misses its table by 4 %
    strong = replace(rig_content.model, circuits=(replace(rig_content.model.circuit, voltage_max_V=40.0),))
    cold = rate(strong, rig_content.actuator, off).feed("cold")
    assert cold.drawn_A == grid.currents[-1]
    assert cold.force_near_N == pytest.approx(off.force[-1, 0], rel=1e-9)
    assert cold.force_far_N == pytest.approx(off.force[-1, -1], rel=1e-9)


def test_the_copper_fills_as_much_of_the_winding_as_its_wires(plunger_content):
    assert copper_share(plunger_content.actuator) == pytest.approx(560 * 0.25 * np.pi * 0.45**2 / (6.0 * 28.0))


def test_beyond_the_knee_ten_per_cent_more_flux_density_take_half_more_field():
    actuator = read_actuator(GEOMETRY / "emaws-saturable.toml")
    steel = next(r.material for r in actuator.fixed if isinstance(r.material, NonlinearMaterial))
    knee, curve = knee_T(steel), BHCurve(steel.flux_density_T, steel.field_A_per_m)
    assert curve.field(1.1 * knee) / curve.field(knee) == pytest.approx(1.5, rel=5e-3)
    assert 0.2 < knee < 0.285  # the ferrite has 0.285 T at 2 kA/m
    assert knee_T(LinearMaterial("iron", 1000.0)) is None


def test_iron_is_judged_beside_its_own_knee_with_the_worst_part_first(plunger_content, rig_content):
    actuator = read_actuator(GEOMETRY / "emaws-saturable.toml")
    largest = {"sleeve": 0.1, "upper_flange": 0.3, "lower_flange": 0.2}
    loads = iron_loads(actuator, replace(rig_content.field, part_flux_density_T=largest))
    assert [load.part for load in loads] == ["upper_flange", "lower_flange", "sleeve"]
    assert loads[0].margin < 0.0 < loads[1].margin
    largest = {"plunger": 1.2, "shell": 0.4, "upper_plate": 1.6, "pole_and_bottom": 1.0}
    loads = iron_loads(plunger_content.actuator, replace(rig_content.field, part_flux_density_T=largest))
    assert [load.part for load in loads] == ["upper_plate", "plunger", "pole_and_bottom", "shell"]
    assert all(load.margin is None for load in loads)  # a linear material does not say where it saturates


def test_only_a_body_that_is_meant_to_hang_is_drawn_where_it_hangs(rig_content, plunger_content):
    assert levitates(rig_content.actuator, rig_content.rows)
    distance, current = picture_point(rig_content.actuator, rig_content.model, rig_content.rows)
    weight = rig_content.weight
    assert float(rig_content.model.force(distance, current)) == pytest.approx(weight, rel=1e-6)
    plunger = plunger_content.actuator
    assert not levitates(plunger, plunger_content.rows)
    point = picture_point(plunger, plunger_content.model, plunger_content.rows)
    assert point == strongest_point(plunger) == (0.0005, 1.0)
