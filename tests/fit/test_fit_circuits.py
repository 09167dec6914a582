"""Several circuits from closed forms: a magnetic bearing of two coils with a bias magnet, and three coupled coils."""

import json

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import DomainError, FitError, MissingPartError, ModelFileError, TableError, UsageError
from femfit.fit.build import fit_model
from femfit.model.dynamics import runge_kutta_step, state_derivative
from femfit.model.json_file import model_from_dict, model_to_dict
from femfit.tables.sweep_table import SweepTable
from support.bearing import CIRCUITS, DISTANCES, ENTRY, NAMES, TRUTH, Bearing, grid, table_of


@pytest.fixture(scope="module")
def fit():
    return fit_model(table_of())


@pytest.fixture(scope="module")
def model(fit):
    return fit.model


BETWEEN = grid(np.linspace(0.21e-3, 0.79e-3, 23), np.linspace(-1.9, 1.9, 5), np.linspace(-1.9, 1.9, 5))


def test_force_flux_linkages_and_inductances_follow_the_closed_form_between_the_rows(model):
    d, i = BETWEEN
    # Nine distances over two hyperbolas: what a spline of fourth degree misses between them.
    force, flux = TRUTH.force(d, i), TRUTH.flux_linkage(d, i)
    assert np.sqrt(np.mean((model.force(d, i) - force) ** 2)) < 2e-3 * np.sqrt(np.mean(force**2))
    assert np.sqrt(np.mean((model.flux_linkage(d, i) - flux) ** 2)) < 5e-4 * np.sqrt(np.mean(flux**2))
    inductance = TRUTH.matrix(d)[0][:, 1:, 1:]
    assert np.abs(model.inductance(d, i) - inductance).max() < 5e-3 * np.abs(inductance).max()


def test_reciprocity_holds_to_rounding(model):
    d, i = BETWEEN
    m, step = model.magnetics, 1e-9
    slope = (m.flux_linkage(d + step, i) - m.flux_linkage(d - step, i)) / (2.0 * step)
    motional = m.motional_constant(d, i)
    np.testing.assert_allclose(motional, -slope, atol=1e-5 * np.abs(motional).max())
    np.testing.assert_array_equal(m.inductance(d, i), m.inductance(d, i).swapaxes(-1, -2))
    for k in range(2):
        raised = i + 1e-3 * np.eye(2)[k]
        lowered = i - 1e-3 * np.eye(2)[k]
        # A quadratic form: central differences are exact.
        np.testing.assert_allclose(
            (m.force(d, raised) - m.force(d, lowered)) / 2e-3, motional[:, k], atol=1e-8 * np.abs(motional).max() + 1e-9
        )
        energy = (m.coenergy(d, raised) - m.coenergy(d, lowered)) / 2e-3
        np.testing.assert_allclose(energy, m.flux_linkage(d, i)[:, k], atol=1e-9)
    force = -(m.coenergy(d + step, i) - m.coenergy(d - step, i)) / (2.0 * step)
    np.testing.assert_allclose(m.force(d, i), force, atol=1e-4 * np.abs(force).max())
    gradient = (m.force(d + step, i) - m.force(d - step, i)) / (2.0 * step)
    np.testing.assert_allclose(m.force_gradient(d, i), gradient, atol=1e-4 * np.abs(gradient).max())


def test_currents_broadcast_against_distances_and_outside_of_the_domain_is_refused(model):
    d = np.linspace(0.3e-3, 0.7e-3, 4)
    assert model.force(d, [0.5, -0.5]).shape == (4,)
    assert model.flux_linkage(d[:, None], np.zeros((4, 3, 2))).shape == (4, 3, 2)
    assert model.inductance(0.5e-3, [0.0, 0.0]).shape == (2, 2)
    with pytest.raises(DomainError, match=r"-2\.\.2 A, -2\.\.2 A.*3 A"):
        model.force(0.5e-3, [0.0, 3.0])
    with pytest.raises(DomainError, match=r"shape \(\.\.\., 2\)"):
        model.force(0.5e-3, 1.0)


def test_the_model_survives_its_file_with_circuits_and_domain(model):
    data = json.loads(json.dumps(model_to_dict(model)))
    again = model_from_dict(data)
    assert again.circuits == model.circuits
    assert [one.name for one in again.circuits] == list(NAMES)
    assert again.circuits[1].drive.diode_V == 0.7
    assert again.validity == model.validity
    np.testing.assert_array_equal(again.force(*BETWEEN), model.force(*BETWEEN))
    first, further = data["circuits"]
    early = {key: value for key, value in data.items() if key != "circuits"} | {"schema": 2}
    assert model_from_dict(early | {"circuit": first, "further_circuits": [further]}).circuits == model.circuits
    with pytest.raises(ModelFileError, match="as many circuits"):
        model_from_dict(data | {"circuits": data["circuits"][:1]})
    data["magnetics"]["coefficients"] = [[0.0]]
    with pytest.raises(ModelFileError, match=r"magnetics\.coefficients"):
        model_from_dict(data)


def test_what_is_printed_names_each_circuit(fit, model):
    text = str(fit)
    assert "lower -2 to 2 A" in text
    assert "1.20 ohm" in str(model)


def test_what_distances_left_out_are_missed_by_is_said_of_five_distances_too(fit):
    few = fit_model(table_of(distances=np.linspace(0.4e-3, 0.6e-3, 5), currents=(-2.0, 2.0)))
    for found in (few, fit):
        assert "with distances left out it misses" in str(found)


def test_what_needs_one_circuit_says_which_there_are(model):
    for call in (model.require_circuit, lambda: model.magnetics.coenergy_derivatives(0.5e-3, 0.0, ((0, 0),))):
        with pytest.raises(MissingPartError, match="lower, upper"):
            call()


def test_one_joule_put_in_is_one_joule_found(model):
    # U i integrated over a transient is heat, kinetic energy, work against the weight and the field's energy.
    state = np.array([0.5e-3, 0.0, 0.2, -0.1])
    voltage = np.array([3.0, 1.0])
    step, R, series = 2e-6, np.array([1.5, 1.2]), np.array([0.0, 1e-3])

    def stored(x):
        d, v, i = x[0], x[1], x[2:]
        m = model.magnetics
        flux = m.flux_linkage(d, i)
        return flux @ i - m.coenergy(d, i) + 0.5 * series @ i**2 + 0.25 * v**2 + 0.5 * 9.81 * d

    put, start = 0.0, stored(state)
    for _ in range(500):
        power = (voltage - R * state[2:]) @ state[2:]
        state = runge_kutta_step(model, state, voltage, step)
        put += 0.5 * step * (power + (voltage - R * state[2:]) @ state[2:])
    # The trapezoidal rule's own error.
    assert stored(state) - start == pytest.approx(put, rel=1e-4)


def test_several_bodies_at_once_move_as_each_alone(model):
    states = np.array([[0.4e-3, 0.1, 0.5, 0.2], [0.6e-3, -0.2, -0.3, 1.0]])
    volts = np.array([[1.0, 2.0], [0.0, -1.0]])
    together = state_derivative(model, states, volts)
    for k in range(2):
        np.testing.assert_allclose(together[k], state_derivative(model, states[k], volts[k]), rtol=1e-12)


class Active(Bearing):
    """Circuits that would give energy away: the mutual inductance is larger than their own."""

    def matrix(self, d):
        M, S = super().matrix(d)
        M = M.copy()
        M[:, 1, 2] = M[:, 2, 1] = -0.1
        S[:, 1, 2] = S[:, 2, 1] = 0.0
        return M, S


class Contradicting(Bearing):
    def force(self, d, i):
        return 2.0 * super().force(d, i)


@pytest.mark.parametrize(
    ("table", "error", "message"),
    [
        (lambda: table_of(Contradicting()), FitError, "a sign or a unit"),
        (lambda: table_of(Active()), FitError, "must be positive definite"),
        (lambda: table_of(distances=DISTANCES[:4]), FitError, "at least 5 distances"),
        (lambda: table_of(currents=(0.0,)), FitError, "do not determine the inductances"),
    ],
)
def test_tables_that_give_no_such_model_are_refused_with_the_reason(table, error, message):
    with pytest.raises(error, match=message):
        fit_model(table())


def test_a_flux_linkage_that_is_missing_is_named():
    table = table_of()
    fewer = SweepTable(table.rows.drop(columns="flux_linkage_upper_Wb"), table.manifest)
    with pytest.raises(TableError, match="flux_linkage_upper_Wb"):
        fit_model(fewer)


def test_a_law_of_one_current_is_refused():
    with pytest.raises(UsageError, match="co-energy alone"):
        fit_model(table_of(), law="F1e")


def test_a_table_without_circuits_gives_the_magnetics_and_says_what_is_missing():
    fit = fit_model(table_of(entry={"name": "bare"}))
    assert fit.model.circuits == ()
    assert "lower, upper" in fit.notes[0]


def test_an_amplifier_of_an_earlier_manifest_has_the_supply_behind_it():
    amplifier = {"kind": "current", "minimum": -1.0, "maximum": 2.0, "bandwidth_Hz": 500.0}
    early = {"name": "upper", "resistance_ohm": 1.2, "drive": amplifier}
    entry = {**ENTRY, "circuits": [CIRCUITS[0], early]}
    upper = fit_model(table_of(entry={**entry, "supply_V": [-12.0, 48.0]})).model.circuits[1]
    assert (upper.voltage_min_V, upper.voltage_max_V) == (-12.0, 48.0)
    assert (upper.drive.kind, upper.drive.current_max_A, upper.drive.bandwidth_Hz) == ("current", 2.0, 500.0)
    unknown = fit_model(table_of(entry=entry))
    assert unknown.model.circuits == ()
    assert "upper" in unknown.notes[0]


def test_the_sensors_of_the_drawing_are_those_of_the_model():
    laser = {"kind": "position", "name": "gap", "noise": 1e-6, "distances_m": [0, 1], "readings": [0, 1], "unit": "m"}
    shunt = {"kind": "current", "name": "shunt", "noise": 1e-3, "circuit": "upper"}
    model = fit_model(table_of(entry={**ENTRY, "sensors": [laser, shunt]})).model
    assert [one.name for one in model.other_sensors] == ["gap", "shunt"]
    assert model.other_sensors[1].circuit == "upper"


def one_circuit(**changed):
    """A coil pair in series: the first circuit's own columns of the bearing, the other without current."""
    d, i = grid(DISTANCES, (-2.0, 0.0, 2.0), (0.0,))
    columns = {"current_A": i[:, 0], "distance_m": d, "force_N": TRUTH.force(d, i)}
    columns |= {"flux_linkage_Wb": TRUTH.flux_linkage(d, i)[:, 0], "status": "ok"}
    entry = {"name": "pair", "mass_kg": 0.5, "circuits": [{**CIRCUITS[1], "name": "pair"}], **changed}
    limits = {"resistance_ohm": 1.2, "voltage_min_V": 0.0, "voltage_max_V": 24.0}
    return fit_model(SweepTable(pd.DataFrame(columns), {"actuator": limits | entry})).model


def test_one_circuit_keeps_its_name_and_what_is_in_series():
    model = one_circuit()
    assert (model.circuit.name, model.circuit.inductance_H, model.circuit.drive.diode_V) == ("pair", 1e-3, 0.7)
    again = model_from_dict(json.loads(json.dumps(model_to_dict(model))))
    assert again.circuit == model.circuit


def test_a_hall_element_that_is_left_out_is_said():
    fit = fit_model(table_of(entry={**ENTRY, "hall": {"sensitivity_V_per_T": 50.0}}))
    assert fit.model.sensor is None
    assert any("Hall element" in note for note in fit.notes)


def test_currents_swept_to_one_side_alone_hold_on_the_other_where_nothing_saturates():
    one_sided = fit_model(table_of(currents=np.array([0.0, 1.0, 2.0]))).model
    np.testing.assert_allclose(one_sided.validity.current_limits_A, [[-2.0, 2.0], [-2.0, 2.0]])
    d, i = BETWEEN
    force, flux = TRUTH.force(d, i), TRUTH.flux_linkage(d, i)
    # As of the table with both signs: the same distances
    assert np.sqrt(np.mean((one_sided.force(d, i) - force) ** 2)) < 2e-3 * np.sqrt(np.mean(force**2))
    assert np.sqrt(np.mean((one_sided.flux_linkage(d, i) - flux) ** 2)) < 5e-4 * np.sqrt(np.mean(flux**2))
