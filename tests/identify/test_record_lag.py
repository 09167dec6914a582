"""Records of a held body whose parts conduct: the lag that the drawing predicts, and one that it does not."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit.identify.decision.diagnose import diagnose
from femfit.identify.refit.add_effects import add_effects
from femfit.identify.series.noise import EddiesAlong, induced_along, pull_of
from femfit.identify.series.observations import series_observations
from femfit.model.drawn_effect import DrawnEffect
from femfit.model.eddy_magnetics import EddyMagnetics
from support.closed_loop import recorded
from support.conductivities import KEY, with_conductivity
from support.eddies import eddies, with_eddies

FINER = 20  # steps of the reference within a sample
PERIOD_S = 1e-3
HELD_M = 0.022


def held(model, seconds=2.0):
    """Samples of a current that goes from level to level, its voltage and Hall voltage: trapezoids in fine steps."""
    n = round(seconds / PERIOD_S) * FINER
    time = np.arange(n + 1) * PERIOD_S / FINER
    levels = 0.4 + 0.3 * np.sign(np.sin(2.0 * np.pi * time / 0.23)) * (1.0 + 0.2 * np.sin(2.0 * np.pi * time / 0.9))
    kernel = np.hanning(12 * FINER)
    current = np.convolve(np.concatenate([np.full(12 * FINER, levels[0]), levels]), kernel / kernel.sum())
    current = current[12 * FINER : 12 * FINER + n + 1]
    eddy, d = model.eddy, np.asarray(HELD_M)
    (at,), inductance = eddy.forms(d), model.inductance(HELD_M, 0.4)
    own, coupling = inductance * at.coupling.T @ at.coupling + at.inductance, inductance * at.coupling[0]
    step, resistance = PERIOD_S / FINER, np.diag(eddy.resistances_ohm)
    before = np.linalg.solve(own + 0.5 * step * resistance, own - 0.5 * step * resistance)
    driven = -np.linalg.solve(own + 0.5 * step * resistance, coupling)
    induced = np.zeros((n + 1, eddy.count))
    for k in range(n):
        induced[k + 1] = before @ induced[k] + driven * (current[k + 1] - current[k])
    magnetics = EddyMagnetics(model.magnetics, eddy)
    whole, distance = np.concatenate([current[:, None], induced], axis=1), np.full(n + 1, HELD_M)
    flux = magnetics.flux_linkage(distance, whole)[:, 0]
    ohmic = model.circuit.resistance_ohm * 0.5 * (current[1:] + current[:-1])
    volts = (ohmic + np.diff(flux) / step).reshape(-1, FINER).mean(axis=1)  # held from sample to sample
    seen = model.sensor.field.derivatives(distance, current + induced @ at.coupling[0])[0]
    seen = seen + induced @ at.hall
    here = slice(None, n, FINER)
    noise = model.sensor.noise_V * np.random.default_rng(5).standard_normal(len(volts))
    hall = model.sensor.quiescent_V + model.sensor.sensitivity_V_per_T * seen[here] + noise
    columns = {"time_s": time[here], "voltage_V": volts, "current_A": current[here], "hall_V": hall}
    return pd.DataFrame({"run": 1.0, **columns, "distance_m": HELD_M})


@pytest.fixture(scope="module")
def model(levitation_model):
    """Without mass: what holds the body is not recorded. Its iron does not saturate at these currents."""
    drawn = DrawnEffect(KEY, (), "the conductivity of core", 6.0, "", 0.1, (), conducts=True)
    return replace(with_eddies(levitation_model), motion=None, drawn=(drawn,), sample_time_s=PERIOD_S)


def test_the_drawing_s_eddy_currents_close_the_balances(model):
    exact = recorded(held(model), distance_m=0.0, current_A=0.0)
    with_them, without = (series_observations(one, exact) for one in (model, replace(model, eddy=None, drawn=())))
    for name, share in (("voltage_balance_V", 0.02), ("hall_V", 0.25)):  # noise is left of the Hall voltage
        left, whole = (np.sqrt(np.mean(one.residual[one.of(name)] ** 2)) for one in (with_them, without))
        assert left < share * whole


def test_a_lag_that_the_drawing_predicts_is_said_to_be_that(model):
    found = diagnose(model, recorded(held(model)), bootstrap=0)
    assert not found.missing
    assert re.search(
        r"lag is what the drawing predicts: the field follows a slow current by \d.* ms at 22 mm", str(found)
    )


@pytest.mark.parametrize(("share", "word"), [(0.1, "more"), (-0.1, "less")])
def test_a_lag_that_it_does_not_predict_is_named_with_its_size(model, share, word):
    built = replace(with_conductivity(model, share), motion=None)
    record = recorded(held(built))
    found = diagnose(model, record, bootstrap=0)
    assert [one.name for one in found.missing] == [KEY]
    said = re.search(
        r"lags a slow current by (.*) ms (more|less) than the (.*) ms that the drawing predicts", str(found)
    )
    assert said, str(found)
    assert said[2] == word
    assert float(said[1]) == pytest.approx(abs(share) * float(said[3]), rel=0.2)
    (effect,) = add_effects(model, record, KEY).model.effects
    assert effect.parameters["change"] == pytest.approx(share, abs=0.01)


def test_a_magnet_without_a_circuit_is_braked_by_what_its_motion_induces():
    """At a constant velocity v each e becomes -lambda' v / R: a force against it of v sum(lambda'^2 / R)."""
    eddy, velocity = eddies((), (2e-3, 5e-3)), 1e-3
    time = np.linspace(0.0, 0.1, 401)
    distance, still = 0.02 + velocity * time, np.zeros((len(time), 1))
    along = EddiesAlong.at(eddy, distance)
    induced = induced_along(along, time, time == 0.0, still, still[..., None])
    slope = along.rising.flux_linkage[-1]
    assert pull_of(along, still, induced)[-1] == pytest.approx(
        velocity * (slope**2 / eddy.resistances_ohm).sum(), rel=1e-3
    )
    assert not along.acting(still, induced).any()
