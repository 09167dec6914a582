"""How long a batch of filters takes; run with ``pytest -m benchmark -s``."""

import time

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.filters.extended import ExtendedFilter
from femfit.filters.holding import holding_current
from femfit.filters.levitation import levitation_process
from femfit.filters.noise import initial_covariance
from femfit.filters.unscented import UnscentedFilter
from femfit.model.with_effects import with_effects
from support.eddies import with_eddies

RUNS, STEPS = 1000, 200


def a_filterpy_step(order):
    """One step of the peer's filter with a linear model and one measurement."""
    points = MerweScaledSigmaPoints(order, alpha=1.0, beta=2.0, kappa=0.0)
    peer = UnscentedKalmanFilter(dim_x=order, dim_z=1, dt=5e-4, hx=lambda x: x[:1], fx=lambda x, _dt: x, points=points)
    peer.Q, peer.R = 1e-6 * np.eye(order), np.array([[1e-4]])
    reading = np.zeros(1)

    def step():
        peer.predict()
        peer.update(reading)

    return step


def a_femfit_step(model, order, runs, kind=UnscentedFilter):
    """One step of our filter with the model's co-energy and Hall field."""
    current = holding_current(model, 0.022)
    filter_ = kind(levitation_process(model, hall_bias=order == 4))
    states = [filter_.start(np.array([0.022, 0.0, current]), runs=runs)]
    reading = np.full(runs, float(model.sensor.voltage(np.asarray(0.022), np.asarray(current))))
    voltage = model.circuit.resistance_ohm * current

    def step():
        states[0] = filter_.step(states[0], voltage, reading)

    return step


@pytest.mark.benchmark
@pytest.mark.parametrize("order", [3, 4])
def test_one_filter_and_a_thousand_beside_filterpy(levitation_model, order):
    """CPU times of turns that alternate, so that what else the machine does meets all of them."""
    steps = {
        "filterpy": (a_filterpy_step(order), 20),
        "one filter": (a_femfit_step(levitation_model, order, 1), 20),
        "a thousand": (a_femfit_step(levitation_model, order, 1000), 2),
    }
    times = {name: [] for name in steps}
    for _ in range(40):
        for name, (step, count) in steps.items():
            start = time.process_time()
            for _ in range(count):
                step()
            times[name].append((time.process_time() - start) / count)
    peer, alone, batch = (float(np.median(values)) for values in times.values())
    print(
        f"\n{order} states: filterpy {1e6 * peer:.0f} us a step, one filter {1e6 * alone:.0f} us ({alone / peer:.2f} "
        f"of it), a thousand {1e3 * batch:.2f} ms ({1000 * peer / batch:.0f} times its rate)"
    )


@pytest.mark.benchmark
@pytest.mark.parametrize("filter_class", [UnscentedFilter, ExtendedFilter])
@pytest.mark.parametrize("hall_bias", [False, True])
def test_a_thousand_filters_at_once(levitation_model, filter_class, hall_bias):
    current = holding_current(levitation_model, 0.022)
    mean = np.array([0.022, 0.0, current, 0.0][: 4 if hall_bias else 3])
    filter_ = filter_class(levitation_process(levitation_model, hall_bias=hall_bias))
    state = filter_.start(mean, initial_covariance(hall_bias_V=0.01 if hall_bias else None), RUNS)
    clean = float(levitation_model.sensor.voltage(np.asarray(0.022), np.asarray(current)))
    readings = clean + levitation_model.sensor.noise_V * np.random.default_rng(0).normal(size=(STEPS, RUNS))
    voltage = levitation_model.circuit.resistance_ohm * current
    wall, cpu = time.perf_counter(), time.process_time()
    for reading in readings:
        state = filter_.step(state, voltage, reading)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    print(
        f"\n{filter_class.__name__}, {len(mean)} states: {RUNS} runs x {STEPS} steps in {wall:.2f} s ({cpu:.2f} s of "
        f"CPU), {RUNS * STEPS / wall / 1e3:.0f} k filter steps a second"
    )
    assert not state.diverged.any()


def usual(name):
    """An effect with every amplitude a third of the way to what is usual at most."""
    effect = effect_by_name(name)
    values = {p.name: p.null + (max(p.plausible, key=abs) - p.null) / 3.0 for p in effect.amplitudes}
    return AddedEffect(effect, effect.null() | values)


@pytest.mark.benchmark
@pytest.mark.parametrize("filter_class", [UnscentedFilter, ExtendedFilter])
@pytest.mark.parametrize(
    "names", [(), ("core_saturation",), ("core_saturation", "eddy_current_lag"), ("hysteresis",)], ids=" and ".join
)
def test_one_filter_of_a_model_with_effects(levitation_model, filter_class, names):
    model = with_effects(levitation_model, [usual(name) for name in names])
    states = 3 + len(model.memory_names)
    mean = np.zeros(states)
    mean[[0, 2]] = 0.022, holding_current(levitation_model, 0.022)
    filter_ = filter_class(levitation_process(model))
    voltage = levitation_model.circuit.resistance_ohm * mean[2]
    reading = levitation_model.sensor.voltage(mean[:1], mean[2:3])
    state = filter_.step(filter_.start(mean, 1e-8 * np.eye(states)), voltage, reading)
    start = time.process_time()
    for _ in range(STEPS):
        state = filter_.step(state, voltage, reading)
    microseconds = (time.process_time() - start) / STEPS * 1e6
    print(f"\n{filter_class.__name__}, {', '.join(names) or 'no effects'}: {microseconds:.0f} us of CPU a step")


@pytest.mark.benchmark
@pytest.mark.parametrize("filter_class", [UnscentedFilter, ExtendedFilter])
@pytest.mark.parametrize("runs", [1, 1000])
def test_three_eddy_currents_beside_none(levitation_model, filter_class, runs):
    """CPU times of turns that alternate."""
    models = {"without": levitation_model, "with": with_eddies(levitation_model)}
    steps = {name: a_femfit_step(model, 3, runs, filter_class) for name, model in models.items()}
    times = {name: [] for name in steps}
    for _ in range(20):
        for name, step in steps.items():
            start = time.process_time()
            for _ in range(5):
                step()
            times[name].append((time.process_time() - start) / 5)
    without, with_them = (1e6 * float(np.median(values)) for values in times.values())
    print(
        f"\n{filter_class.__name__}, {runs} at once: {without:.0f} us a step without, {with_them:.0f} us with three "
        f"eddy currents ({with_them / without:.1f} times)"
    )
