"""Two circuits that saturate, from a closed form: fit, reciprocity, Jacobian, energy, model file."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import FitError, MissingPartError, ModelFileError, SimulationError
from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.fit.build import fit_model
from femfit.model.dynamics import runge_kutta_step, state_derivative, state_jacobian
from femfit.model.json_file import model_from_dict, model_to_dict
from femfit.model.readings import predict_readings
from femfit.model.several_magnetics import CoenergyTensor
from femfit.model.with_effects import nominal_of, with_effects
from femfit.simulation.open_loop import simulate
from support.bearing import NAMES, grid, table_of

ENERGY, REACH, LEAK = 0.02, 0.6e-3, 0.15
DISTANCES, CURRENTS = np.linspace(0.2e-3, 0.8e-3, 9), np.linspace(-2.0, 2.0, 7)


class Saturating:
    """W' = sum of E (sqrt(1 + q_k^2) - 1), q_1 = (i_1 + l i_2 + b) r / (d + r), q_2 the same from the other side."""

    def parts(self, d, i):
        d, i = np.asarray(d)[..., None], np.asarray(i)
        gap = np.concatenate([d + REACH, 1e-3 + REACH - d], axis=-1)
        drive = 1.2 * (i @ np.array([[1.0, LEAK], [LEAK, 1.0]]) + 0.3)
        q = drive * REACH / gap
        rising = np.array([-1.0, 1.0]) / gap  # dq/dd over q
        return q, rising, 1.2 * REACH / gap

    def force(self, d, i):
        q, rising, _ = self.parts(d, i)
        return -np.sum(ENERGY * q**2 * rising / np.sqrt(1.0 + q**2), axis=-1)

    def flux_linkage(self, d, i):
        q, _, per_ampere = self.parts(d, i)
        return (ENERGY * q / np.sqrt(1.0 + q**2) * per_ampere) @ np.array([[1.0, LEAK], [LEAK, 1.0]])


TRUTH = Saturating()


def table(distances=DISTANCES, currents=CURRENTS):
    drawn = table_of()
    d, i = grid(distances, currents, currents)
    flux = TRUTH.flux_linkage(d, i)
    rows = pd.DataFrame({"distance_m": d, "force_N": TRUTH.force(d, i), "force_error_N": 0.0, "status": "ok"})
    for k, name in enumerate(NAMES):
        rows[f"current_{name}_A"], rows[f"flux_linkage_{name}_Wb"] = i[:, k], flux[:, k]
    return replace(drawn, rows=rows)


@pytest.fixture(scope="module")
def fit():
    return fit_model(table())


@pytest.fixture(scope="module")
def model(fit):
    return fit.model


BETWEEN = grid(np.linspace(0.21e-3, 0.79e-3, 13), np.linspace(-1.9, 1.9, 7), np.linspace(-1.9, 1.9, 5))


def test_force_and_flux_linkages_follow_the_closed_form_between_the_points(fit, model):
    d, i = BETWEEN
    assert isinstance(model.magnetics, CoenergyTensor)
    errors = []
    for found, true in (
        (model.force(d, i), TRUTH.force(d, i)),
        (model.flux_linkage(d, i), TRUTH.flux_linkage(d, i)),
    ):
        errors.append(np.sqrt(np.mean((found - true) ** 2) / np.mean(true**2)))
    assert max(errors) < 5e-3  # seven currents over a knee
    assert max(errors) < fit.circuits.left_out_worst  # what is printed covers what is true between the points
    assert "with points left out" in fit.circuits.lines()[0]


def test_every_derivative_is_that_of_the_one_coenergy(model):
    d, i = BETWEEN
    m, n = model.magnetics, 2
    step, shift = 1e-8, 1e-4 * np.eye(2)

    def along_d(function):
        return (function(d + step, i) - function(d - step, i)) / (2.0 * step)

    def along_i(function, k):
        return (function(d, i + shift[k]) - function(d, i - shift[k])) / 2e-4

    def close(found, true, within=2e-5):
        np.testing.assert_allclose(found, true, atol=within * np.abs(true).max())

    slopes = m.slopes_of_circuits(d, i)
    close(m.force(d, i), -along_d(m.coenergy))
    close(m.force_gradient(d, i), along_d(m.force))
    close(slopes.force_gradient, along_d(m.force))
    close(slopes.inductance_gradient, along_d(m.inductance))
    close(slopes.motional_gradient, along_d(m.motional_constant))
    for k in range(n):
        close(m.flux_linkage(d, i)[:, k], along_i(m.coenergy, k))
        close(m.motional_constant(d, i)[:, k], along_i(m.force, k))
        close(m.motional_constant(d, i)[:, k], -along_d(lambda *at, k=k: m.flux_linkage(*at)[:, k]))
        close(m.inductance(d, i)[:, :, k], along_i(m.flux_linkage, k))
        close(slopes.inductance_slope[..., k], along_i(m.inductance, k), 1e-3)  # straight lines that meet at the knots
    np.testing.assert_array_equal(m.inductance(d, i), m.inductance(d, i).swapaxes(-1, -2))
    state = m.state_of_circuits(d, i)
    np.testing.assert_array_equal(state.force, m.force(d, i))
    assert m.force(0.5e-3, np.zeros(2)).shape == ()
    assert m.inductance(d[:4, None], i[None, :3]).shape == (4, 3, 2, 2)


def test_the_jacobian_of_the_motion_is_that_of_its_equations(model):
    state = np.array([[0.4e-3, 0.1, 1.2, -0.7], [0.6e-3, -0.2, -1.5, 1.8]])
    volts = np.array([[3.0, -2.0], [1.0, 4.0]])
    found = state_jacobian(model, state, volts)
    for k, step in enumerate((1e-9, 1e-6, 1e-5, 1e-5)):
        moved = step * np.eye(4)[k]
        slope = (state_derivative(model, state + moved, volts) - state_derivative(model, state - moved, volts)) / (
            2 * step
        )
        np.testing.assert_allclose(found[..., k], slope, rtol=2e-4, atol=1e-4 * np.abs(slope).max())


def test_energy_put_in_is_energy_found(model):
    """Without copper losses, the work of the sources is the change of field, motion and height."""
    lossless = [replace(one, resistance_ohm=1e-12) for one in model.circuits]
    free = replace(model, circuits=tuple(lossless))
    state, volts, step, work = np.array([0.5e-3, 0.0, 0.2, 0.1]), np.array([4.0, 3.0]), 2e-6, 0.0

    def stored(x):
        at = x[0], x[2:]
        field = x[2:] @ free.magnetics.flux_linkage(*at) - free.magnetics.coenergy(*at)
        height = free.motion.mass_kg * free.motion.gravity_m_s2 * x[0]
        return float(field + 0.5 * free.motion.mass_kg * x[1] ** 2 - height)

    before = stored(state)
    for _ in range(400):
        after = runge_kutta_step(free, state, volts, step)
        risen = free.magnetics.flux_linkage(after[0], after[2:]) - free.magnetics.flux_linkage(state[0], state[2:])
        work += float(0.5 * (state[2:] + after[2:]) @ risen)  # U dt = d(flux linkage)
        state = after
    assert stored(state) - before == pytest.approx(work, rel=1e-5)


def test_the_model_survives_its_file(model):
    again = model_from_dict(model_to_dict(model), "model.json")
    d, i = BETWEEN
    np.testing.assert_array_equal(again.force(d, i), model.force(d, i))
    np.testing.assert_array_equal(again.inductance(d, i), model.inductance(d, i))
    damaged = model_to_dict(model)
    damaged["magnetics"]["circuits"][1]["degree"] = 3
    with pytest.raises(ModelFileError, match="knots_A"):
        model_from_dict(damaged, "model.json")


def test_points_that_failed_at_an_edge_and_inside_are_left_out():
    whole = table()
    found = fit_model(replace(whole, rows=whole.rows.drop(index=[0, 40]).reset_index(drop=True)))
    d, i = BETWEEN
    true = TRUTH.force(d, i)
    assert np.sqrt(np.mean((found.model.force(d, i) - true) ** 2) / np.mean(true**2)) < 5e-3


def test_a_winding_of_few_turns_is_judged_by_its_own_flux_linkage(fit):
    drawn = table()
    column = f"flux_linkage_{NAMES[1]}_Wb"
    few = {f"current_{NAMES[1]}_A": drawn.rows[f"current_{NAMES[1]}_A"] * 50.0, column: drawn.rows[column] / 50.0}
    fair = fit_model(replace(drawn, rows=drawn.rows.assign(**few))).circuits
    assert fair.share == pytest.approx(fit.circuits.share, rel=0.2)
    few[column] = 1.2 * few[column]
    with pytest.raises(FitError):  # reciprocity does not hold between the force and this winding
        fit_model(replace(drawn, rows=drawn.rows.assign(**few)))


def test_four_currents_over_a_sharp_knee_are_said_to_be_too_few():
    with pytest.raises(FitError, match="Sweep more currents"):
        fit_model(table(currents=np.array([-40.0, -13.0, 13.0, 40.0])))


def test_too_few_currents_or_no_grid_is_refused_with_what_is_needed():
    whole = table().rows
    ends = whole[whole[f"current_{NAMES[0]}_A"].abs() == 2.0]
    with pytest.raises(FitError, match="3 currents or more"):
        fit_model(replace(table(), rows=ends.reset_index(drop=True)))
    alone = whole[(whole[f"current_{NAMES[0]}_A"] == 0.0) | (whole[f"current_{NAMES[1]}_A"] == 0.0)]
    with pytest.raises(FitError, match="every combination"):
        fit_model(replace(table(), rows=alone.reset_index(drop=True)))


def test_more_turns_of_one_circuit_are_more_of_its_current_in_the_one_coenergy(model):
    """W'(d, 1.1 i_1, i_2): force of the scaled current, 1.1 times its flux; a remanence has no part."""
    turns = AddedEffect(effect_by_name("turns:lower"), {"turns_error": 0.1})
    changed, d, i = with_effects(model, [turns]), np.linspace(0.3e-3, 0.7e-3, 5), np.tile([0.8, -0.4], (5, 1))
    scaled = i * [1.1, 1.0]
    np.testing.assert_allclose(changed.magnetics.force(d, i), model.magnetics.force(d, scaled), rtol=1e-9)
    linked = model.magnetics.flux_linkage(d, scaled) * [1.1, 1.0]
    np.testing.assert_allclose(changed.magnetics.flux_linkage(d, i), linked, rtol=1e-9)
    read = predict_readings(changed, d, i, Conditions(nominal_of(model)))
    np.testing.assert_allclose(read["flux_linkage_lower_Wb"], linked[:, 0], rtol=1e-9)
    with pytest.raises(MissingPartError, match="remanence"):
        with_effects(model, [AddedEffect(effect_by_name("remanence"), {"remanence_error": 0.1})])


def test_a_circuit_beyond_its_currents_keeps_its_inductance(fit):
    magnetics, d = fit.model.magnetics, np.linspace(0.25e-3, 0.75e-3, 7)
    at_the_end = magnetics.inductance(d, np.array([2.0, 0.7]))[:, 0, 0]
    assert at_the_end.min() > 0.0
    far = magnetics.inductance(d, np.array([9.0, 0.7]))
    np.testing.assert_allclose(far[:, 0, 0], at_the_end, rtol=1e-9)
    step = np.array([1e-4, 0.0])
    rise = magnetics.flux_linkage(d, np.array([9.0, 0.7]) + step) - magnetics.flux_linkage(d, [9.0, 0.7] - step)
    np.testing.assert_allclose(rise / 2e-4, far[:, 0], rtol=1e-6, atol=1e-9)


def test_currents_swept_to_one_side_alone_are_said_of_windings_without_a_diode():
    one_sided = fit_model(table(currents=np.linspace(0.0, 2.0, 5)))
    assert one_sided.model.validity.current_limits_A.min() == 0.0
    (note,) = (note for note in one_sided.notes if "one side of 0 A" in note)
    assert f"currents of {NAMES[0]} to one side" in note  # the other one's driver has a diode


def test_currents_swept_to_both_sides_are_not_spoken_of(fit):
    assert not any("one side of 0 A" in note for note in fit.notes)


def test_a_simulation_that_reaches_inductances_that_are_not_positive_definite_is_refused(fit):
    def motion(volts):
        command = dict.fromkeys(NAMES, volts)
        return simulate(fit.model, voltage_V=command, start_m=0.5e-3, duration_s=2e-3, outside="extrapolate")

    assert motion(3.5).end_s == 2e-3
    with pytest.raises(SimulationError, match="Keep it within the validity domain"):
        motion(24.0)
