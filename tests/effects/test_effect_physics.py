"""Effects against computations that do not know their formulas: field solutions, superposition, play operators."""

from dataclasses import replace

import casadi as ca
import magpylib
import numpy as np
import pytest
from numpy.polynomial.chebyshev import Chebyshev
from scipy.optimize import least_squares, lsq_linear

from femfit.core.graph import row_of
from femfit.device.parts import LinearMaterial
from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect, EffectPoint
from femfit.field.layout import layout_of, stretch_groups
from femfit.field.problem import prepare
from femfit.field.tolerance import SolverSettings
from femfit.integrate.field_of_current import play_paths
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of
from support.coenergies import partials
from support.saturating import LIBRARY, rig_with_core

QUICK = SolverSettings(order=3, corner_fraction=0.25)
DISTANCES = (0.015, 0.019, 0.026, 0.036, 0.045)
CURRENTS = np.linspace(-1.4, 1.4, 8)
SCALES = {"force_N": 4e-4, "flux_linkage_Wb": 2e-5, "hall_T": 6e-5}  # noise of a good bench
CURVE = LIBRARY["ferrite_k10"].material
LINEAR = LinearMaterial("linear", relative_permeability=800.0)  # the curve's own beginning


def solved(core, remanence=1.0):
    """Force, flux linkage and Hall field of the rig; each of shape (distances, currents)."""
    rig = rig_with_core(core, DISTANCES)
    (magnet,) = rig.moving.regions
    weaker = replace(magnet, material=replace(magnet.material, remanence_T=remanence * magnet.material.remanence_T))
    sweep = replace(rig.sweep, currents_A=tuple(CURRENTS))
    rig = replace(rig, moving=replace(rig.moving, regions=(weaker,)), sweep=sweep)
    layout, rows = layout_of(rig, QUICK), {}
    for group in stretch_groups(DISTANCES, layout, QUICK):
        problem = prepare(rig, group, layout, QUICK)
        rows |= {d: problem.rows(d, rig.sweep.currents_A) for d in group}
    return {name: np.array([rows[d][name] for d in DISTANCES]) for name in SCALES}


def linear_coenergy(table):
    """W' of a linear solution at its own distances: quadratic in the current, its slope the solved force."""
    force, flux, hall = (np.polynomial.polynomial.polyfit(CURRENTS, table[n].T, 2) for n in SCALES)
    rows = np.column_stack([DISTANCES, flux[0], 0.5 * flux[1], *force, hall[0], hall[1]])
    between = 0.5 * (np.array(DISTANCES[1:]) + DISTANCES[:-1])

    def evaluate(d, i, h):
        at, flux_0, flux_1, force_0, force_1, force_2, hall_0, hall_1 = ca.vertsplit(row_of(rows, [between], [d]))
        force = force_0 + force_1 * i + force_2 * i**2
        return flux_0 * i + flux_1 * i**2 - (d - at) * force + h * (hall_0 + hall_1 * i)

    return evaluate


@pytest.fixture(scope="module")
def linear():
    return solved(LINEAR)


@pytest.fixture(scope="module")
def nominal(linear, levitation_model):
    return replace(
        nominal_of(levitation_model),
        current_min_A=-1.4,
        force_N=np.abs(linear["force_N"]).max(),
        flux_linkage_Wb=np.abs(linear["flux_linkage_Wb"]).max(),
        inductance_H=float(np.ptp(linear["flux_linkage_Wb"][2]) / 2.8),
    )


GRID = [x.ravel() for x in np.meshgrid(DISTANCES, CURRENTS, indexing="ij")]


def acting(effect, base, conditions, parameters):
    """W'(d, i, h) under the effect."""
    values = effect.null() | parameters
    return lambda d, i, h: effect.coenergy(base, EffectPoint(d, i, conditions, values, h))


def slope(coenergy, d, i, *order):
    """One partial derivative in d, i and h."""
    return partials(coenergy, d, i, (order,))[0]


def read(coenergy):
    by_d, linkage, field = partials(coenergy, *GRID, ((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    return {"force_N": -by_d, "flux_linkage_Wb": linkage, "hall_T": field}


@pytest.mark.nightly
def test_the_family_of_core_saturation_describes_a_nonlinear_field_solution(linear, nominal):
    effect, base, saturated = effect_by_name("core_saturation"), linear_coenergy(linear), solved(CURVE)
    width = np.array([p.plausible[1] - p.plausible[0] for p in effect.parameters])
    target = np.concatenate([(saturated[n] - linear[n]).ravel() / s for n, s in SCALES.items()])

    def left(x):
        values = dict(zip((p.name for p in effect.parameters), x * width, strict=True))
        found = read(acting(effect, base, Conditions(nominal), values))
        return target - np.concatenate([(found[n] - linear[n].ravel()) / s for n, s in SCALES.items()])

    low, high = (np.array([getattr(p, end) for p in effect.parameters]) / width for end in ("lower", "upper"))
    start = np.array([p.null if p.nonlinear else 0.1 * p.plausible[1] for p in effect.parameters]) / width
    fit = least_squares(left, start, bounds=(low, high), max_nfev=60)
    assert np.sqrt(np.mean(target**2)) > 10.0  # what is described is large: ten times the noise
    assert np.linalg.norm(fit.fun) < 0.05 * np.linalg.norm(target)


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("magnet_demagnetisation", {"loss": 0.08}),
        pytest.param("magnet_temperature", {"coefficient_per_K": -4e-3}, marks=pytest.mark.nightly),
    ],
)
def test_a_weaker_magnet_is_the_field_solution_with_less_remanence(name, parameters, linear, nominal):
    at = Conditions(nominal, magnet_temperature_C=40.0)
    found = read(acting(effect_by_name(name), linear_coenergy(linear), at, parameters))
    for channel, values in solved(LINEAR, remanence=0.92).items():
        # Linear iron is exactly homogeneous; the solver's rounding is left
        np.testing.assert_allclose(found[channel], values.ravel(), atol=1e-6 * np.abs(values).max())


def on_axis(d, height, radius=0.0055, remanence=1.45):
    """B_z on the axis at the distance d from a cylinder magnet's face (closed form)."""
    far = d + height
    return 0.5 * remanence * (far / np.sqrt(far**2 + radius**2) - d / np.sqrt(d**2 + radius**2))


def test_a_demagnetised_layer_is_the_field_of_the_rest_of_the_magnet(nominal):
    effect, d = effect_by_name("magnet_demagnetisation"), np.linspace(0.015, 0.045, 7)
    values = {"layer_m": 5e-4, "magnet_height_m": 0.005}
    coenergy = acting(effect, lambda d, i, h: h * on_axis(d, 0.005), Conditions(nominal), values)
    found = slope(coenergy, d, 0.0, 0, 0, 1)
    exact, whole = on_axis(d + 5e-4, 0.0045), on_axis(d, 0.005)
    # At three times its height a magnet is a dipole to within (height / distance)^2, 11 %, of this change's own half
    np.testing.assert_allclose(found - whole, exact - whole, rtol=0.05)


def offset_magnet(d, e):
    """A coil of 30 loops below z = 0 at 1 A and a cylinder magnet above it, off the axis by e."""
    places = [(0, 0, -z) for z in np.linspace(0, 0.015, 30)]
    loops = [magpylib.current.Circle(diameter=0.03, current=1.0, position=place) for place in places]
    magnet = magpylib.magnet.Cylinder(polarization=(0, 0, 1.45), dimension=(0.011, 0.005), position=(e, 0, d + 0.0025))
    force, _ = magpylib.getFT(loops, magnet, meshing=400)
    return -float(np.sum(np.reshape(force, (-1, 3))[:, 2])), magpylib.getB(magnet, (0, 0, 0))[2]


def test_a_lateral_offset_is_the_superposition_of_loops_in_three_dimensions(nominal):
    effect, e = effect_by_name("lateral_misalignment"), 1.5e-3
    nodes = 0.030 + 0.017 * np.cos(np.pi * (np.arange(12) + 0.5) / 12)
    axis = np.array([offset_magnet(d, 0.0) for d in nodes])
    force, field = (Chebyshev.fit(nodes, column, 11, domain=[0.013, 0.047]) for column in axis.T)
    work, offset = force.integ(), {"offset_squared_m2": e**2}
    coenergy = acting(effect, lambda d, i, h: h * field(d) - i * work(d), Conditions(nominal), offset)
    d = np.array([0.016, 0.020, 0.028, 0.040])
    exact = np.array([offset_magnet(x, e) for x in d]) - np.stack([force(d), field(d)], axis=1)
    # The next term of the expansion is (e/d)^2 / 2 of this one at the smallest distance
    np.testing.assert_allclose(-slope(coenergy, d, 1.0, 1, 0, 0) - force(d), exact[:, 0], rtol=0.03)
    np.testing.assert_allclose(slope(coenergy, d, 1.0, 0, 0, 1) - field(d), exact[:, 1], rtol=0.03)


def test_a_small_cores_attraction_falls_off_the_axis_as_the_image_share_says():
    # A dipole at (e, d) polarises a small sphere: W' ~ B^2 ~ (4 d^2 + e^2) / (d^2 + e^2)^4; W'' = 168 / d^8
    d, e = 1.0, 1e-3
    fall = ((4 * d**2 + e**2) / (d**2 + e**2) ** 4 - 4 / d**6) / (-0.25 * e**2 * 168 / d**8)
    share = next(p for p in effect_by_name("lateral_misalignment").parameters if p.name == "image_share")
    assert share.null == pytest.approx(fall, abs=0.06)
    assert share.plausible[0] <= 0.0  # an infinite plate's image follows the magnet


def test_the_family_of_inductance_describes_a_small_iron_body_before_a_coil(nominal):
    # The body's moment grows with the coil's field on the axis and is seen through the same field
    effect, d = effect_by_name("position_dependent_inductance"), np.linspace(0.015, 0.045, 16)
    seen = 0.01**4 / (0.01**2 + (d + 0.0075) ** 2) ** 3
    ones = [acting(effect, lambda *_: 0.0, Conditions(nominal), {p.name: 1.0}) for p in effect.amplitudes]
    columns = [slope(one, d, 1.0, 0, 1, 0) for one in ones]
    fit = lsq_linear(np.stack(columns, axis=1), seen)
    assert np.linalg.norm(fit.fun) < 0.03 * np.linalg.norm(seen)


def test_a_plunger_beside_its_axis_is_a_gap_of_less_reluctance_in_series(nominal):
    effect = effect_by_name("lateral_misalignment")
    plunger = replace(nominal, magnet_share=0.0)
    d, i = np.array([0.016, 0.021, 0.032]), np.array([0.4, 0.9, 1.3])
    series, bore = 4.0 + 1000.0 * d, 0.02  # reluctances over N^2: working gap and the rest, change of the bore's
    gap = bore * plunger.flux_linkage_Wb / plunger.peak_current_A
    plain = acting(effect, lambda d, i, h: 0.5 * i**2 / (4.0 + 1000.0 * d), Conditions(plunger), {"gap_all": gap})
    # First order in 0.02 of 20 and more: the next is a thousandth of it
    np.testing.assert_allclose(slope(plain, d, i, 0, 1, 0) - i / series, i / (series - bore) - i / series, rtol=2e-3)
    change = -0.5 * i**2 * 1000.0 * (1.0 / (series - bore) ** 2 - 1.0 / series**2)
    base_slope = -0.5 * i**2 * 1000.0 / series**2
    np.testing.assert_allclose(slope(plain, d, i, 1, 0, 0) - base_slope, change, rtol=3e-3)


def test_the_family_of_hysteresis_describes_a_sum_of_play_operators(nominal):
    effect = effect_by_name("hysteresis")
    rising = np.linspace(-1.4, 1.4, 281)
    fine = np.concatenate([rising, rising[::-1]])
    seen = np.concatenate([np.arange(0, 281, 20), 281 + np.arange(0, 281, 20)])
    i, branch = fine[seen], np.repeat([1.0, -1.0], 15)
    cycles = play_paths(np.array([0.05, 0.15, 0.4]), np.zeros(3), np.tile(fine, 3)) @ [0.5, 0.3, 0.2]
    loop = cycles[-len(fine) :][seen] - i  # of the last
    at = Conditions(nominal, branch=branch, current_turn_A=(-1.4, 1.4))

    def column(name):
        p = effect.null() | {name: 1.0}
        states = effect.memory.steady_state(i, i, at, p)
        linkage = []
        for k, current in enumerate(i):
            held = Conditions(nominal, memory={name: z[k] for name, z in states.items()})
            coenergy = acting(effect, lambda d, i, h: 0.5 * i**2, held, p)  # lambda = i
            linkage.append(slope(coenergy, 0.0, current, 0, 1, 0))
        return np.array(linkage) - i

    # A straight line is the base's own
    columns = np.stack([*(column(p.name) for p in effect.amplitudes), i, np.ones(30)], axis=1)
    low = [p.lower for p in effect.amplitudes] + [-np.inf] * 2
    high = [p.upper for p in effect.amplitudes] + [np.inf] * 2
    fit = lsq_linear(columns, loop, bounds=(low, high))
    straight = loop - np.polyval(np.polyfit(i, loop, 1), i)
    assert np.linalg.norm(fit.fun) < 0.07 * np.linalg.norm(straight)


def test_fluxmeter_and_ammeter_tell_more_turns_from_a_wrong_current(levitation_model):
    d, i = np.array([0.018, 0.03]), np.array([0.4, 1.2])
    conditions = Conditions(nominal_of(levitation_model))
    more, other = (
        predict_readings(levitation_model, d, i, conditions, [AddedEffect(effect_by_name(name), {key: 0.04})])
        for name, key in (("turns", "turns_error"), ("current_gain", "gain_error"))
    )
    for channel in ("force_N", "hall_V", "voltage_V"):
        np.testing.assert_allclose(more[channel], other[channel], rtol=1e-12)
    np.testing.assert_allclose(more["flux_linkage_Wb"], 1.04 * other["flux_linkage_Wb"], rtol=1e-12)


def test_the_lag_of_a_core_is_finite_at_any_current(nominal):
    hysteresis = effect_by_name("hysteresis")
    p = hysteresis.null() | {"width_medium": 0.02, "fade": 6.0}
    far = np.array([-1e6, 0.0, 1e6])
    conditions = Conditions(nominal, branch=1.0, current_turn_A=(-1.4, 1.4))
    states = hysteresis.memory.steady_state(far, far, conditions, p)
    assert all(np.isfinite(z).all() for z in states.values())
