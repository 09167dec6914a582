"""One run and a batch have the same numbers, and filterpy 2.0.0 too; slopes are those of differences."""

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from femfit.core.numerics import central_differences
from femfit.device.electrics import AccelerationSensor, ForceSensor
from femfit.estimate.kalman_filter import kalman_filter
from femfit.estimate.moments import ExtendedFilter, UnscentedFilter
from support.added_effects import under_effects
from support.eddies import with_eddies
from support.halves import cut_in_two
from support.readings import LASER, SHUNT, initial_covariance, read_by
from support.solenoids import searched

SEVERAL = (SHUNT, LASER, AccelerationSensor(name="mems", noise=0.5), ForceSensor(name="cell", noise=0.02))
RUNS, STEPS = 3, 45


def halves(rig):
    return cut_in_two(replace(rig, sensor=None, other_sensors=(LASER, replace(SHUNT, circuit="inner"))))


def with_pickup(_):
    model = searched(noise=2e-3)
    return replace(model, other_sensors=(*model.other_sensors, SHUNT))


CASES = {
    "hall": (lambda rig: rig, {}),
    "bias of the hall element": (lambda rig: rig, {"hall_bias": True}),
    "effects": (lambda rig: under_effects(rig, ("core_saturation", {"mmf_loss_3": 0.02})), {}),
    "effects of the bench": (lambda _: under_effects(read_by(*SEVERAL), ("current_gain", {"gain_error": 0.25})), {}),
    "eddy currents": (with_eddies, {}),
    "laser and current": (lambda _: read_by(*SEVERAL), {"sensors": ("laser", "current")}),
    "bias of the force": (
        lambda _: read_by(*SEVERAL), {"sensors": ("cell", "mems", "current"), "biases": ("cell",)}
    ),
    "pickup coil": (with_pickup, {"sensors": ("search", "current")}),
    "halves": (halves, {}),
}  # fmt: skip


def first_of(model):
    """A state at rest or near it, without what a filter adds to the model's."""
    n = len(model.circuits)
    first = [3.5e-3, 0.0, 0.1] if model.sample_time_s == 1e-4 else [0.022, 0.0, *[0.32] * n]
    return [*first, *[0.0] * (len(model.state_names) - len(first))]


def a_record(filter_, first, volts):
    """Readings (steps, runs, sensors) of motions by the filter's own process; of several sensors some are missing."""
    generator, process = np.random.default_rng(3), filter_.process
    states, readings = filter_.start(first, runs=RUNS).mean.copy(), []
    states[:, 0] += 1e-5 * np.arange(RUNS)
    for given in volts:
        states = process.transition(states, given)
        read = np.stack([process.measure(output.name, states) for output in process.outputs], axis=1)
        readings.append(read + generator.standard_normal(read.shape) * [o.variance**0.5 for o in process.outputs])
    result = np.array(readings)
    if result.shape[2] > 1:
        result[::3, :, 0] = np.nan
        result[::5] = np.nan
    return result


def assert_same(state, wanted, run, tolerance):
    """In standard deviations."""
    deviation = np.sqrt(np.diagonal(wanted.covariance[0]))
    np.testing.assert_allclose(state.mean[run] / deviation, wanted.mean[0] / deviation, rtol=0.0, atol=tolerance)
    scale = deviation[:, None] * deviation
    np.testing.assert_allclose(state.covariance[run] / scale, wanted.covariance[0] / scale, rtol=0.0, atol=tolerance)
    np.testing.assert_allclose(state.innovation[run], wanted.innovation[0], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("kind", ["ukf", "ekf"])
@pytest.mark.parametrize("name", CASES)
def test_the_quick_step_the_general_path_and_a_batch_agree(name, kind, levitation_model):
    make, options = CASES[name]
    model = make(levitation_model)
    filter_, n = kalman_filter(model, kind, **options), len(model.circuits)
    first = first_of(model)
    rest = model.resistances_ohm * (first[2] if n else 0.0)
    volts = rest + np.random.default_rng(5).uniform(-0.2, 0.2, (STEPS, RUNS, n))
    volts = volts[..., 0] if n == 1 else volts
    readings = a_record(filter_, first, volts)
    readings = readings[..., 0] if readings.shape[2] == 1 else readings
    batch = filter_.start(first, runs=RUNS)
    for given, read in zip(volts, readings, strict=True):
        batch = filter_.step(batch, given, read)
    assert not batch.diverged.any()
    # A pickup coil's reading is a difference over 0.1 ms, whose rounding is ten thousand times that of a flux linkage
    tolerance = 1e-6 if name == "pickup coil" else 1e-9
    for run in range(RUNS):
        alone = general = filter_.start(first)
        for given, read in zip(volts[:, run], readings[:, run], strict=True):
            alone = filter_.step(alone, given, read)
            general = filter_.update(filter_.predict(general, given), read)
        assert_same(alone, general, 0, tolerance)
        assert_same(batch, general, run, tolerance)  # summation order may differ with the batch's size; nothing else


SLOPES = CASES | {
    "late laser": (lambda _: read_by(SHUNT, replace(LASER, delay_s=1.5e-4)), {}),
    "late pickup coil": (lambda _: searched(noise=2e-3, delay_s=1.5e-4), {}),
    "halves with eddy currents": (lambda rig: with_eddies(halves(rig)), {}),
}


@pytest.mark.parametrize("name", SLOPES)
def test_the_slopes_of_steps_and_readings_are_those_of_differences(name, levitation_model):
    """In the deviations of the start, which say what is large."""
    make, options = SLOPES[name]
    model = make(levitation_model)
    filter_, n, generator = kalman_filter(model, "ekf", **options), len(model.circuits), np.random.default_rng(4)
    process = filter_.process
    scale = np.sqrt(np.diag(process.start_covariance))
    states = filter_.start(first_of(model), runs=6).mean + 0.02 * scale * generator.normal(size=(6, process.order))
    volts = generator.uniform(0.0, 2.0, (6, n) if n > 1 else 6)
    repeated = np.concatenate([volts] * (2 * process.order))
    wanted = central_differences(lambda x: process.transition(x, repeated), states, scale) * scale
    size = np.abs(wanted).max(axis=0) + 1e-3 * scale[:, None]  # rounded over steps of 1e-5 of what is large
    assert (np.abs(process.with_slopes(states, volts)[1] * scale - wanted) / size).max() < 1e-6
    for output in process.outputs:
        reading = central_differences(lambda x, o=output: process.measure(o.name, x)[:, None], states, scale)[:, 0]
        found, wanted = process.gradient(output.name, states) * scale, reading * scale
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-6 * np.abs(wanted).max())


# In units of the standard deviation. Different orders of summation give up to 5e-12 over this record; an approximation
# of any kind, or the other choice of sigma points, shows above 1e-4.
AGREEMENT = 1e-10


def assert_as_the_oracle(filter_, oracle, step):
    """Along a record of 75 ms, in which what a body is off grows by a factor of ten; ``step`` moves the oracle."""
    process, n = filter_.process, filter_.process.order
    start = np.array([0.0225, 0.01, 0.3, 0.005][:n]), initial_covariance(biases=(0.01,))[:n, :n]
    state = filter_.start(*start)
    oracle.x, oracle.P = start
    oracle.Q, oracle.R = process.process_covariance, np.array([[process.outputs[0].variance]])
    volts = np.tile(0.86 + 0.1 * np.sin(0.1 * np.pi * np.arange(150))[:, None], RUNS)
    readings = a_record(filter_, [0.022, 0.0, 0.32], volts)
    for voltage, hall in zip(volts[:, 0], readings[:, -1, 0], strict=True):
        state = filter_.step(state, voltage, hall)
        step(voltage, np.array([hall]))
        sigma = np.sqrt(np.diag(oracle.P))
        assert np.abs((state.mean[0] - oracle.x) / sigma).max() < AGREEMENT
        assert np.abs((state.covariance[0] - oracle.P) / np.outer(sigma, sigma)).max() < AGREEMENT
    assert not state.diverged.any()


@pytest.fixture(params=[False, True], ids=["3-states", "4-states"])
def process(request, levitation_model):
    return kalman_filter(levitation_model, hall_bias=request.param).process


def test_ukf_equals_filterpy(process):
    n = process.order
    oracle = UnscentedKalmanFilter(
        dim_x=n,
        dim_z=1,
        dt=process.model.sample_time_s,
        hx=lambda x: process.measure(process.outputs[0].name, x[None]),
        fx=lambda x, _dt, u: process.transition(x[None], np.array([u]))[0],
        points=MerweScaledSigmaPoints(n, alpha=1.0, beta=2.0, kappa=0.0),
    )

    def step(voltage, reading):
        oracle.predict(u=voltage)
        oracle.update(reading)

    assert_as_the_oracle(UnscentedFilter(process), oracle, step)


def test_ekf_equals_filterpy(process):
    oracle = ExtendedKalmanFilter(dim_x=process.order, dim_z=1)

    def step(voltage, reading):
        inputs = np.array([voltage])
        oracle.F = process.with_slopes(oracle.x[None], inputs)[1][0]
        moved = process.transition(oracle.x[None], inputs)[0]
        oracle.predict()
        oracle.x = moved
        oracle.update(
            reading,
            HJacobian=lambda x: process.gradient(process.outputs[0].name, x[None]),
            Hx=lambda x: process.measure(process.outputs[0].name, x[None]),
        )

    assert_as_the_oracle(ExtendedFilter(process), oracle, step)
