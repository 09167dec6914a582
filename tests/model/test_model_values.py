"""What a user asks a model for: force, flux linkage, inductance, impedance about a bias, and what it is made of."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import DomainError
from femfit.device.load import read_actuator, sweep_manifest_entry
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.model.bspline import DistanceCoordinate
from femfit.model.drawn_effect import DrawnEffect
from femfit.model.impedance import impedance_change
from femfit.model.json_file import read_model, write_model
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.model.readings import predict_readings
from femfit.model.validity import ActuatorKind, ValidityBox
from femfit.model.with_effects import nominal_of, with_effects
from support.actuators import GEOMETRY
from support.added_effects import added
from support.eddies import with_eddies
from support.impedances import KEY, changed_impedance, with_conductivity, with_drawn_conductivity
from support.one_current import flat, within

KIND = ActuatorKind(False, True, True, False, True, False)
BOX = ValidityBox.of_currents((0.015, 0.045), (0.0, 1.4))


@pytest.mark.parametrize("quantity", ["force", "flux_linkage", "inductance"])
def test_a_model_is_evaluated_at_numbers_and_arrays_of_its_validity_domain(levitation_model, quantity):
    evaluate = getattr(levitation_model, quantity)
    d, i = np.linspace(0.016, 0.04, 5), np.linspace(0.1, 1.3, 5)
    np.testing.assert_array_equal(evaluate(d, i), getattr(flat(levitation_model.magnetics), quantity)(d, i))
    assert float(evaluate(d[2], i[2])) == evaluate(d, i)[2]
    for distance, current in ((7.0, 1.0), (0.02, 20.0), (float("nan"), 1.0)):
        with pytest.raises(DomainError, match=r"15\.\.45 mm and 0\.\.1\.4 A"):
            evaluate(distance, current)
        assert not np.isfinite(distance) or np.isfinite(evaluate(distance, current, extrapolate=True))


def test_the_validity_box_holds_its_edges_and_no_nan_and_spans_a_grid_of_all_currents():
    rows = [
        (0.015, 0.0, True), (0.045, 1.4, True), (0.015 - 1e-12, 0.0, True), (0.0149, 0.5, False), (0.0451, 0.5, False),
        (0.02, -0.01, False), (0.02, 1.41, False), (np.nan, 0.5, False), (0.02, np.nan, False), (np.inf, 0.5, False),
    ]  # fmt: skip
    distance, current, inside = np.array(rows).T
    assert BOX.contains(distance, current[:, None]).tolist() == inside.astype(bool).tolist()
    BOX.require(np.array([0.02, 0.03]), np.array([0.5]))
    with pytest.raises(DomainError, match=r"15\.\.45 mm and 0\.\.1\.4 A.*received 60 mm and 0\.5 A"):
        BOX.require(np.array([0.02, 0.06]), np.array([0.5]))
    with pytest.raises(DomainError, match="received nan mm"):
        BOX.require(np.asarray(np.nan), np.array([0.5]))
    d, i = ValidityBox.of_currents((1e-3, 2e-3), (0.0, 1.0), (-1.0, 1.0)).grid(2, 3)
    assert (d.shape, i.shape) == ((18,), (18, 2))
    assert {tuple(row) for row in i.tolist()} == {(a, b) for a in (0.0, 0.5, 1.0) for b in (-1.0, 0.0, 1.0)}
    assert ValidityBox.of_currents((1e-3, 2e-3), (0.0, 1.0)).grid(2, 3)[1].shape == (6, 1)


def test_the_drawing_or_a_force_without_current_decides_whether_there_is_a_magnet(levitation_model):
    law = LawMagnetics("F1e", (Coefficient("d^-2", 2, 1e-6, ""),), {}, 0.016, 0.0)
    steel = replace(levitation_model, magnetics=law)
    energised = replace(levitation_model, validity=within(levitation_model.validity, low=0.25))
    for model, has_magnet, is_known in (
        (levitation_model, True, True),
        (replace(levitation_model, kind=replace(KIND, moving_magnet=False)), False, True),
        (steel, False, True),
        (replace(steel, kind=KIND), True, True),
        (energised, False, False),
        (replace(energised, kind=KIND), True, True),
    ):
        assert nominal_of(model).has_magnet is has_magnet
        assert model.magnet_known is is_known
    assert levitation_model.has_magnet


@pytest.mark.parametrize(
    ("file", "kind"),
    [
        ("emaws.toml", KIND),
        ("plunger-solenoid.toml", ActuatorKind(False, False, True, True, True, False)),
        ("emaws-saturable.toml", replace(KIND, saturates=True)),
    ],
)
def test_a_drawing_says_what_kind_of_actuator_it_is(file, kind):
    assert ActuatorKind(**sweep_manifest_entry(read_actuator(str(GEOMETRY / file)))["kind"]) == kind


LAG = {"ring_share": 0.3, "diffusion_share": 0.1, "time_s": 2e-3}


def test_without_eddy_currents_it_is_the_resistance_and_the_inductance(levitation_model):
    model = replace(levitation_model, circuits=(replace(levitation_model.circuit, inductance_H=2e-3),))
    f = np.array([0.0, 50.0, 1e4])
    z = model.impedance(0.022, 0.5, f)
    np.testing.assert_allclose(z.real, model.circuit.resistance_ohm)
    np.testing.assert_allclose(z.imag, 2.0 * np.pi * f * (2e-3 + model.inductance(0.022, 0.5)))
    assert model.impedance([[0.02], [0.03]], 0.5, f).shape == (2, 3)


@pytest.mark.parametrize("frequency", [-1.0, np.nan])
def test_what_is_no_frequency_is_refused(levitation_model, frequency):
    with pytest.raises(DomainError, match="Frequencies"):
        levitation_model.impedance([0.02, 0.03, 0.025, 0.026], 0.5, frequency)


def test_a_lag_of_the_flux_shows_as_its_own_equation_of_states_says(levitation_model):
    """A small sinusoidal current through the states' rates, which are linear: z' = A z + b i'."""
    lag, nominal, w = added("eddy_current_lag", **LAG), nominal_of(levitation_model), 2.0 * np.pi * 80.0

    def rates(states, current_rate):
        named = dict(zip(lag.memory.names, np.transpose([states]), strict=True))
        moving = Conditions(nominal, current_rate_A_s=np.array([current_rate]))
        return np.array([*lag.memory.rate(named, np.zeros(1), moving, lag.parameters).values()])[:, 0]

    matrix = np.column_stack([rates(row, 0.0) for row in np.eye(2)])
    states = np.linalg.solve(1j * w * np.eye(2) - matrix, 1j * w * rates(np.zeros(2), 1.0))
    share = 1.0 - nominal.peak_current_A * np.dot([LAG["ring_share"], LAG["diffusion_share"]], states)
    expected = levitation_model.circuit.resistance_ohm + 1j * w * share * levitation_model.inductance(0.022, 0.5)
    assert with_effects(levitation_model, [lag]).impedance(0.022, 0.5, 80.0) == pytest.approx(expected, rel=1e-9)
    assert abs(share) < 0.9


BOTH = ("resistance_ohm", "inductance_H")


@pytest.mark.parametrize("name", ["eddy_current_lag", "turns"])
def test_a_bench_reads_the_same_impedance_without_and_with_eddy_currents_beside_effects(levitation_model, name):
    lag = name == "eddy_current_lag"
    model = levitation_model if lag else with_eddies(levitation_model)
    effect = added(name, **LAG) if lag else added(name, turns_error=0.04)
    f, d, i = np.array([np.nan, 20.0, 300.0, 5e3]), np.full(4, 0.022), np.full(4, 0.5)
    at = Conditions(nominal_of(model), frequency_Hz=f)
    read = predict_readings(model, d, i, at, [effect], ("inductance_H", "resistance_ohm"))
    z = with_effects(model, [effect]).impedance(d[1:], i[1:], f[1:])
    tabulated = 1e-4  # what a table of eddy currents or of an inductance is told to
    np.testing.assert_allclose(read["resistance_ohm"][1:], z.real, rtol=1e-9 if lag else tabulated)
    np.testing.assert_allclose(read["inductance_H"][1:], z.imag / (2.0 * np.pi * f[1:]), rtol=tabulated)
    ohms, drawn = model.circuit.resistance_ohm, model.impedance(d[1:], i[1:], f[1:]).real
    if lag:
        assert read["inductance_H"][0] == pytest.approx(model.inductance(0.022, 0.5), rel=1e-9)
        assert read["resistance_ohm"][0] == pytest.approx(ohms, rel=1e-12)
    else:  # all that flux induces goes with the square of the turns, the wire's resistance with their number
        np.testing.assert_allclose(read["resistance_ohm"][1:] - 1.04 * ohms, 1.04**2 * (drawn - ohms), rtol=1e-9)


def test_between_its_grid_a_change_is_the_conductivity_s(levitation_model):
    model = with_drawn_conductivity(levitation_model)
    generator = np.random.default_rng(3)
    d, i = generator.uniform(0.016, 0.044, 40), generator.uniform(0.1, 1.3, 40)
    f = np.exp(generator.uniform(np.log(15.0), np.log(15e3), 40))
    at = Conditions(nominal_of(model), frequency_Hz=f)
    change = AddedEffect(model.drawn[0].effect, {"change": 0.01})
    read = predict_readings(model, d, i, at, [change], BOTH)
    z = read["resistance_ohm"] + 2j * np.pi * f * read["inductance_H"]
    exact, drawn = (with_conductivity(levitation_model, s).impedance(d, i, f) for s in (0.01, 0.0))
    # A hundredth of the conductivity: what is left is its square, and the spline's error
    assert np.abs(z - exact).max() < 0.02 * np.abs(exact - drawn).max()


def test_the_conductivity_of_all_that_conducts_is_exact_and_kept_in_the_model_file(levitation_model, tmp_path):
    drawn = DrawnEffect(KEY, "the conductivity of core", "", 6.0, 0.1, conducts=True)
    model = replace(with_eddies(levitation_model), drawn=(drawn,))
    added = with_effects(model, [AddedEffect(drawn.effect, {"change": 0.25})])
    write_model(added, tmp_path / "model.json")
    again, exact = read_model(tmp_path / "model.json"), with_conductivity(levitation_model, 0.25)
    d, i, f = np.full(3, 0.021), np.full(3, 0.4), np.array([30.0, 400.0, 5e3])
    np.testing.assert_allclose(again.impedance(d, i, f), exact.impedance(d, i, f), rtol=1e-12)
    read = predict_readings(again, d, i, Conditions(nominal_of(model), frequency_Hz=f), channels=BOTH)
    np.testing.assert_allclose(read["resistance_ohm"], exact.impedance(d, i, f).real, rtol=1e-12)
    (kept,) = again.without_effects.drawn
    assert kept.conducts
    assert kept.effect.needs == drawn.effect.needs


def test_one_level_stands_for_all():
    coordinate = DistanceCoordinate(0.03)
    f = np.array([10.0, 100.0, 1000.0])
    slope = np.array([[[1.0 + 2.0j, 3.0, 5.0j]]])
    one = impedance_change("change", coordinate, np.array([0.02]), np.array([0.0]), f, slope)
    at = changed_impedance(one, np.full(3, 0.04), np.full(3, 0.7), f, {"change": 2.0})
    np.testing.assert_allclose(at, 2.0 * slope[0, 0])
    assert not changed_impedance(one, np.array([0.02]), np.zeros(1), np.zeros(1), {"change": 2.0}).any()
