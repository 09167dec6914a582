"""How long a batch of filters takes; run with ``pytest -m benchmark -s``."""

import time

import numpy as np
import pytest

from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.filters.extended import ExtendedFilter
from femfit.filters.levitation import levitation_process
from femfit.filters.noise import initial_covariance
from femfit.filters.square_root import SquareRootUnscentedFilter
from femfit.filters.theory import holding_current
from femfit.filters.unscented import UnscentedFilter
from femfit.model.with_effects import with_effects

RUNS, STEPS = 1000, 200


@pytest.mark.benchmark
@pytest.mark.parametrize("filter_class", [UnscentedFilter, SquareRootUnscentedFilter, ExtendedFilter])
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
    state.require_running()


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
