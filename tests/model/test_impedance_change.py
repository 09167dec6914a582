"""What a drawn conductivity changes of an impedance: a spline of distance, bias and frequency."""

from dataclasses import replace

import numpy as np

from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.drawn_effect import DrawnEffect
from femfit.model.impedance import impedance_change
from femfit.model.json_file import read_model, write_model
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of, with_effects
from support.conductivities import KEY, with_conductivity, with_drawn_conductivity
from support.eddies import with_eddies

BOTH = ("resistance_ohm", "inductance_H")


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
    drawn = DrawnEffect(KEY, (), "the conductivity of core", 6.0, "", 0.1, (), conducts=True)
    model = replace(with_eddies(levitation_model), drawn=(drawn,))
    added = with_effects(model, [AddedEffect(drawn.effect, {"change": 0.25})])
    write_model(added, tmp_path / "model.json")
    again, exact = read_model(tmp_path / "model.json"), with_conductivity(levitation_model, 0.25)
    d, i, f = np.full(3, 0.021), np.full(3, 0.4), np.array([30.0, 400.0, 5e3])
    np.testing.assert_allclose(again.impedance(d, i, f), exact.impedance(d, i, f), rtol=1e-12)
    np.testing.assert_allclose(again.force_transfer(d, i, f), exact.force_transfer(d, i, f), rtol=1e-12)
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
    at = one(np.full(3, 0.04), np.full(3, 0.7), f, None, {"change": 2.0})
    np.testing.assert_allclose(at, 2.0 * slope[0, 0])
    assert one(np.array([0.02]), np.array([0.0]), np.zeros(1), None, {"change": 2.0}) == 0.0


def test_a_model_file_keeps_it_as_a_number_and_as_an_added_effect(levitation_model, tmp_path):
    model = with_drawn_conductivity(levitation_model)
    added = with_effects(model, [AddedEffect(model.drawn[0].effect, {"change": 0.05})])
    write_model(added, tmp_path / "model.json")
    again = read_model(tmp_path / "model.json")
    d, i, f = np.full(3, 0.021), np.full(3, 0.4), np.array([30.0, 400.0, 5e3])
    at = Conditions(nominal_of(model), frequency_Hz=f)
    read, later = (predict_readings(one, d, i, at, channels=BOTH) for one in (added, again))
    for name in BOTH:
        np.testing.assert_allclose(later[name], read[name], rtol=1e-12)
    z = again.impedance(d, i, f)
    np.testing.assert_allclose(z.real, read["resistance_ohm"], rtol=1e-12)
    np.testing.assert_allclose(z.imag, 2.0 * np.pi * f * read["inductance_H"], rtol=1e-12)
    (drawn,) = again.without_effects.drawn
    assert drawn.effect.needs == ("frequency_Hz", "inductance_H|resistance_ohm")
    change, kept = (predict_readings(model, d, i, at, [AddedEffect(e, {"change": 0.1})], BOTH)
                    for e in (model.drawn[0].effect, drawn.effect))  # fmt: skip
    for name in BOTH:
        np.testing.assert_allclose(kept[name], change[name], rtol=1e-12)
