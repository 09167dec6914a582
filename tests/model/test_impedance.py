"""The impedance of a model about a bias, and what a lagging flux linkage shows of itself in it."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import DomainError
from femfit.effects.conditions import Conditions
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of, with_effects
from support.added_effects import added
from support.eddies import with_eddies

LAG = {"ring_share": 0.3, "diffusion_share": 0.1, "time_s": 2e-3}


def test_without_eddy_currents_it_is_the_resistance_and_the_inductance(levitation_model):
    model = replace(levitation_model, circuits=(replace(levitation_model.circuit, inductance_H=2e-3),))
    f = np.array([0.0, 50.0, 1e4])
    z = model.impedance(0.022, 0.5, f)
    np.testing.assert_allclose(z.real, model.circuit.resistance_ohm)
    np.testing.assert_allclose(z.imag, 2.0 * np.pi * f * (2e-3 + model.inductance(0.022, 0.5)))
    assert model.impedance([[0.02], [0.03]], 0.5, f).shape == (2, 3)


@pytest.mark.parametrize("frequency", [-1.0, np.nan, np.ones((2, 3))])
def test_what_is_no_frequency_is_refused(levitation_model, frequency):
    with pytest.raises(DomainError, match="Frequencies"):
        levitation_model.impedance([0.02, 0.03, 0.025, 0.026], 0.5, frequency)


def test_a_lag_of_the_flux_shows_as_its_own_equation_of_states_says(levitation_model):
    """A sinusoidal current through the states' rates, integrated until it is periodic: flux linkage over current."""
    lag, nominal = added("eddy_current_lag", **LAG), nominal_of(levitation_model)
    f, small, steps, periods = 80.0, 1e-3, 2000, 8
    w, dt = 2.0 * np.pi * f, 1.0 / f / steps
    memory, p = lag.memory, lag.parameters
    states = {name: np.zeros(1) for name in memory.names}
    flux = []
    for k in range(steps * periods):
        # Trapezoid rule: the rate is linear in the states, so that two evaluations give its slope
        rates = [small * w * np.cos(w * dt * n) for n in (k, k + 1)]
        now = memory.rate(states, np.zeros(1), Conditions(nominal, current_rate_A_s=rates[0]), p)
        guess = {name: states[name] + dt * now[name] for name in states}
        later = memory.rate(guess, np.zeros(1), Conditions(nominal, current_rate_A_s=rates[1]), p)
        states = {name: states[name] + 0.5 * dt * (now[name] + later[name]) for name in states}
        if k >= steps * (periods - 1):
            lagging = sum(p[f"{mode}_share"] * states[f"eddy_{mode}"] for mode in ("ring", "diffusion"))
            shift = nominal.peak_current_A * lagging
            flux.append(small * np.sin(w * dt * (k + 1)) - float(shift[0]))
    t = dt * np.arange(steps * (periods - 1) + 1, steps * periods + 1)
    share = 2.0 / steps * np.sum(np.array(flux) * np.exp(-1j * w * t)) * 1j / small
    model = with_effects(levitation_model, [lag])
    z = model.impedance(0.022, 0.5, f)
    expected = levitation_model.circuit.resistance_ohm + 1j * w * share * levitation_model.inductance(0.022, 0.5)
    assert z == pytest.approx(expected, rel=1e-4)  # the trapezoid rule's error at 2,000 steps a period
    assert abs(share) < 0.9


def test_a_lag_is_passive_and_vanishes_at_low_frequency(levitation_model):
    model = with_effects(levitation_model, [added("eddy_current_lag", **LAG)])
    z = model.impedance(0.022, 0.5, np.geomspace(1e-2, 1e5, 40))
    assert (np.diff(z.real) > 0.0).all()
    assert z[0] == pytest.approx(levitation_model.impedance(0.022, 0.5, 1e-2), rel=1e-6)
    inductance = z.imag / (2.0 * np.pi * np.geomspace(1e-2, 1e5, 40))
    assert inductance[-1] == pytest.approx(0.6 * levitation_model.inductance(0.022, 0.5), rel=1e-3)


def test_a_bench_reads_the_same_impedance(levitation_model):
    f = np.array([np.nan, 20.0, 300.0])
    d, i = np.full(3, 0.022), np.full(3, 0.5)
    at = Conditions(nominal_of(levitation_model), frequency_Hz=f)
    read = predict_readings(
        levitation_model, d, i, at, [added("eddy_current_lag", **LAG)], ("inductance_H", "resistance_ohm")
    )
    z = with_effects(levitation_model, [added("eddy_current_lag", **LAG)]).impedance(d[1:], i[1:], f[1:])
    np.testing.assert_allclose(read["resistance_ohm"][1:], z.real, rtol=1e-9)
    np.testing.assert_allclose(read["inductance_H"][1:], z.imag / (2.0 * np.pi * f[1:]), rtol=1e-4)  # of a table
    assert read["inductance_H"][0] == pytest.approx(levitation_model.inductance(0.022, 0.5), rel=1e-9)
    assert read["resistance_ohm"][0] == pytest.approx(levitation_model.circuit.resistance_ohm, rel=1e-12)


def test_a_bench_reads_eddy_currents_beside_effects(levitation_model):
    model = with_eddies(levitation_model)
    f, d, i = np.array([20.0, 300.0, 5e3]), np.full(3, 0.022), np.full(3, 0.5)
    turns = added("turns", turns_error=0.04)
    changed = with_effects(model, [turns])
    at = Conditions(nominal_of(model), frequency_Hz=f)
    read = predict_readings(model, d, i, at, [turns], ("inductance_H", "resistance_ohm"))
    z = changed.impedance(d, i, f)
    np.testing.assert_allclose(read["resistance_ohm"], z.real, rtol=1e-4)  # of a table
    np.testing.assert_allclose(read["inductance_H"], z.imag / (2.0 * np.pi * f), rtol=1e-4)
    # All that flux induces goes with the square of the turns, the wire's resistance with their number
    ohms, drawn = model.circuit.resistance_ohm, model.impedance(d, i, f).real
    np.testing.assert_allclose(read["resistance_ohm"] - 1.04 * ohms, 1.04**2 * (drawn - ohms), rtol=1e-9)
