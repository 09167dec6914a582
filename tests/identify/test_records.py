"""Records of closed loops: their windows and balances, clean ones name nothing, hidden effects are found in them."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import sparse
from scipy.signal import lfilter

import femfit as ff
from femfit.core.errors import TableError
from femfit.device.electrics import PositionSensor
from femfit.device.mechanics import Mechanics, Spring
from femfit.effects.catalogue import BUILT_IN, effect_by_name
from femfit.effects.conditions import Conditions
from femfit.identify.bench import placed
from femfit.identify.series.measured import SensorNoise, propagated
from femfit.identify.series.motion import Induced, Motion, states_along
from femfit.identify.series.observations import series_observations
from femfit.identify.series.samples import between_samples, held_from, take_samples
from femfit.identify.series.weights import Windows, local_polynomials, window_weights
from femfit.identify.signatures import why_untestable
from femfit.model.drawn_effect import DrawnEffect
from femfit.model.eddy_currents import EddyMagnetics
from femfit.model.magnetics import MagneticState
from femfit.model.with_effects import nominal_of, with_effects
from support.campaign import hidden, without
from support.closed_loop import closed_loop, recorded
from support.eddies import eddies, with_eddies
from support.impedances import KEY, with_conductivity
from support.one_current import flat
from support.solenoids import solenoid
from support.switching import STEP_S, logged, switched


def test_balances_of_an_undisturbed_record_close_far_below_what_effects_do(model, loops):
    observations = series_observations(model, recorded(loops, distance_m=0.0, current_A=0.0))
    assert observations.channels == ("force_balance_N", "voltage_balance_V", "hall_V")
    rms = observations.rms(observations.residual)
    # Of 0.043 N and 3 V: the windows' own error beside the kinks that a held command makes
    assert rms["force_balance_N"] < 5e-5 * 0.043
    assert rms["voltage_balance_V"] < 5e-6 * 3.0


def test_the_voltage_of_an_inductance_in_series_is_balanced_too(model):
    coil = replace(model, circuits=(replace(model.circuit, inductance_H=0.02),))  # as much as the winding's own
    samples = closed_loop(coil, seconds=1.0)
    for gain_error in (0.0, 0.1):
        read = samples.assign(current_A=samples["current_A"] / (1.0 + gain_error))
        observations = series_observations(coil, recorded(read, distance_m=0.0, current_A=0.0))
        left = observations.value - observations.predict([hidden("current_gain", gain_error=gain_error)])
        assert np.sqrt(np.mean(left[observations.of("voltage_balance_V")] ** 2)) < 2e-5 * 3.0


@pytest.mark.parametrize("how", [{}, {"lost": 0.02}, {"converter_A": 5e-3}, {"distance_m": 3e-5, "current_A": 4e-3}])
def test_the_scatter_of_the_balances_is_what_the_sensors_noise_makes(model, loops, how):
    observations = series_observations(model, recorded(loops, seed=1, runs=range(1, 7), **how))
    # Some 360 windows: 4 %; a converter's error is no white noise and is bounded from above
    low = 0.6 if "converter_A" in how else 0.85
    for name, rms in observations.rms(observations.residual).items():
        assert low < rms / observations.declared_noise[name] < 1.15


def test_a_hall_reading_is_as_late_as_the_drawing_says(model, loops):
    late = loops.assign(hall_V=loops.groupby("run")["hall_V"].shift(10))
    series = recorded(late, runs=range(1, 7), distance_m=0.0, current_A=0.0)
    observations = series_observations(replace(model, sensor=replace(model.sensor, delay_s=0.01)), series)
    rms = observations.rms(observations.residual)["hall_V"]
    assert rms < 1.15 * observations.declared_noise["hall_V"]
    unaware = series_observations(model, series)
    assert rms < 0.5 * unaware.rms(unaware.residual)["hall_V"]


# The gate opens on 1 % of clean campaigns: two openings are less likely than 1 % among twelve
@pytest.mark.parametrize("records", [2, pytest.param(12, marks=pytest.mark.nightly)])
def test_clean_records_name_nothing_though_the_hall_noise_is_fed_back(model, loops, records):
    ways = [{}, {"lost": 0.02}, {"converter_A": 5e-3, "current_A": 3e-4}, {"distance_m": 3e-5, "current_A": 4e-3}]
    series = [recorded(loops, seed=run, runs=(run,), **ways[run % 4]) for run in range(1, records + 1)]
    verdicts = [ff.diagnose(model, record).verdict for record in series]
    assert verdicts.count("nothing_missing") >= records - 1
    assert "named" not in verdicts


def test_many_clean_runs_together_show_no_structure_in_any_channel(model, loops):
    # A Hall element's noise drives the current that follows it: settings must be taken from before a reading
    assert ff.compare(model, recorded(loops, seed=2, runs=range(1, 13))).p_value > 0.01


# A closed loop does not tell mass and pull apart, nor a sagging supply from a larger resistance
HIDDEN = {
    "viscous_friction": ({"damping_per_s": 6.0}, 0.2, set()),
    "motional_emf": ({"share": 1.0}, 0.3, set()),
    "core_saturation": ({"mmf_loss_3": 0.04}, 0.3, set()),
    "driver_gain": ({"gain_error": 0.03}, 0.05, set()),
    "eddy_current_lag": ({"ring_share": 0.15, "time_s": 4e-3}, None, set()),  # its share and its time go together
    "mass_error": ({"mass_error": 0.03}, 0.3, {"constant_force"}),
    "supply_sag": ({"inner_resistance": 0.05}, 0.3, {"resistance"}),
    "side_pull_friction": ({"share": 0.05}, 0.3, set()),
}


@pytest.mark.nightly
@pytest.mark.parametrize("name", HIDDEN)
def test_a_hidden_effect_is_in_the_class_with_its_size_and_a_model_that_has_it_lacks_nothing(model, name):
    (size, rel, beside), effect = HIDDEN[name], hidden(name, **HIDDEN[name][0])
    record = recorded(closed_loop(model, [effect], seconds=2.0, seed=3))
    result = ff.diagnose(model, record)
    assert result.verdict == "named"
    assert {name, *beside} <= set(result.missing[0].members)
    if rel and result.missing[0].name == name:
        assert {key: result.missing[0].parameters[key] for key in size} == pytest.approx(size, rel=rel)
    if name == "viscous_friction":
        assert ff.diagnose(with_effects(model, [effect]), record).verdict == "nothing_missing"
    if name == "mass_error":
        assert result.where.channel == "force_balance_N"


def test_dry_friction_of_a_body_that_stands_or_turns_is_any_force_up_to_its_size():
    """Driven slowly up and down, it is held for some milliseconds wherever it turns."""
    drawn = solenoid(Mechanics(0.025, 0.0, springs=(Spring(600.0, 0.0, 3e-3),), viscous_N_s_per_m=0.5, coulomb_N=0.03))
    time = 1e-3 * np.arange(1000)
    volts = 7.0 + 3.0 * (2.0 / np.pi) * np.arcsin(np.sin(4.0 * np.pi * time))
    record = logged([switched(time, volts, 1.0, model=drawn, start_m=2.8e-3)], noise=(5e-4, 2e-6))
    compared = ff.compare(drawn, record)
    assert compared.verdict == "agrees", str(compared)
    assert "stands" in {told.code for told in compared.findings}
    smooth = replace(drawn, motion=replace(drawn.motion, coulomb_N=0.0))
    result = ff.diagnose(smooth, record)
    assert [cause.name for cause in result.missing] == ["coulomb_friction"], str(result)
    weight = nominal_of(smooth).weight_N
    assert result.missing[0].parameters["level"] * weight == pytest.approx(drawn.motion.coulomb_N, rel=0.1)


@pytest.mark.nightly
def test_a_heavier_body_is_not_charged_with_the_noise_of_its_acceleration(model):
    samples, left = closed_loop(model, [hidden("mass_error", mass_error=0.2)], runs=6, seconds=2.5, seed=5), []
    for seed in range(1, 8):
        result = ff.diagnose(model, recorded(samples, seed=seed, runs=range(1, 7), distance_m=3e-5))
        assert result.missing[0].name == "mass_error"
        assert result.missing[0].parameters["mass_error"] == pytest.approx(0.2, rel=0.025)
        fall = {one.channel: one for one in result.error_fall.channels}
        left.append(fall["force_balance_N"].after_over_noise)
    # Weighed by the true mass, the noise of the distance would leave a fifth more; of 7 x 30 windows chance makes 5 %
    assert 0.9 < np.sqrt(np.mean(np.square(left))) < 1.1


def test_records_that_cannot_be_balanced_are_refused_with_the_remedy(model, loops):
    record = recorded(loops)
    unplaced, rows = without(record, "distance_m"), record.rows
    laser = PositionSensor(name="laser", distances_m=(0.0, 0.1), readings=(0.5, 80.5), unit="V")
    for device, series, words in (
        (replace(model, other_sensors=(laser,)), unplaced, r"--column HEADER=position_V"),
        (model, unplaced, r"^(?!.*position_V)[\s\S]*distance_m"),
        (model, replace(record, rows=rows.assign(distance_m=1e3 * rows["distance_m"])), "in mm"),
        (model, replace(record, rows=rows.iloc[:20]), "gap"),
    ):
        with pytest.raises(TableError, match=words):
            series_observations(device, series)


FINER = 20  # steps of the winding within a sample
HELD_M = 0.022
EVEN = np.linspace(0.0, 1.0, 201)
UNEVEN = np.sort(np.random.default_rng(0).random(201))
UNEVEN[[0, -1]] = 0.0, 1.0
SEGMENT = np.zeros(201, dtype=int)
ONE = Windows(np.array([0.3, 0.7]), np.array([0, 0]), 0.4)


@pytest.mark.parametrize("time", [EVEN, UNEVEN], ids=["even", "uneven"])
def test_means_and_mean_derivatives_of_a_quintic_are_exact_whatever_the_sampling(time):
    weights = window_weights(ONE, time, SEGMENT, SEGMENT == 0)
    polynomial = np.polynomial.Polynomial([0.3, -1.0, 2.0, 5.0, -4.0, 7.0])
    fine = np.linspace(-1.0, 1.0, 20001)
    bump = (1.0 - fine**2) ** 2
    for order, rows in enumerate((weights.mean, weights.slope, weights.curvature)):
        derivative = polynomial.deriv(order) if order else polynomial
        expected = [np.sum(bump * derivative(c + 0.2 * fine)) / np.sum(bump) for c in ONE.centre_s]
        np.testing.assert_allclose(rows @ polynomial(time), expected, rtol=1e-7)  # the fine sum's own error


def test_windows_with_a_gap_or_too_few_samples_are_not_valid():
    weights = window_weights(ONE, EVEN, SEGMENT, (EVEN < 0.25) | (EVEN > 0.35))
    assert weights.valid.tolist() == [False, True]
    assert abs(weights.mean[[0]]).sum() == 0.0
    assert not window_weights(ONE, EVEN, SEGMENT, np.arange(201) % 20 == 0).valid.any()


def test_local_polynomials_are_exact_up_to_their_degree_and_may_look_back_alone():
    nodes = np.array([0.0, 0.41, 0.8])
    cubic = np.polynomial.Polynomial([1.0, 2.0, -3.0, 4.0])
    level, slope = local_polynomials(nodes, SEGMENT[:3], UNEVEN, SEGMENT, nodes, (0.1, 0.1), 3)
    np.testing.assert_allclose(level @ cubic(UNEVEN), cubic(nodes), rtol=1e-8)
    np.testing.assert_allclose(slope @ cubic(UNEVEN), cubic.deriv()(nodes), rtol=1e-6)
    level, slope = local_polynomials(nodes[1:], SEGMENT[:2], UNEVEN, SEGMENT, nodes[1:] - 0.05, (0.2, 0.0), 3)
    np.testing.assert_allclose(slope @ cubic(UNEVEN), cubic.deriv()(nodes[1:]), rtol=1e-6)
    assert UNEVEN[level[[0]].indices].max() <= 0.36


def test_the_error_of_a_coarse_converter_does_not_average_until_noise_dithers_it():
    mean = sparse.csr_array(np.full((1, 400), 1.0 / 400.0))
    generator, errors = np.random.default_rng(5), {}
    for sigma in (0.0, 1.0):
        draws = []
        for level in generator.random(300):
            values = np.round(level + sigma * generator.standard_normal(400))
            draws.append(float((mean @ values)[0]) - level)
        white = np.hypot(sigma, 1.0 / np.sqrt(12.0))
        said = propagated(mean, {"hall_V": SensorNoise(white, 1.0, values)}, {"hall_V": mean})
        errors[sigma] = np.std(draws), float(said[0])
    for seen, said in errors.values():
        assert said == pytest.approx(seen, rel=0.15)  # 300 draws


def test_states_along_a_motion_follow_their_equation(levitation_model):
    added = hidden("eddy_current_lag", ring_share=0.2, time_s=0.02)
    nominal = nominal_of(levitation_model)
    time = np.linspace(0.0, 0.5, 2001)
    current = 0.7 + 0.2 * np.sin(25.0 * time)
    first = np.zeros(2001, dtype=bool)
    first[[0, 1200]] = True
    still = np.zeros(2001)
    none = np.zeros((2001, 0))
    motion = Motion(levitation_model, time, first, still + HELD_M, current[:, None], none, Conditions(nominal))
    states = states_along(added, motion, motion.distance_m, current, still)
    seen = states["eddy_ring"] * nominal.peak_current_A
    # x' = i' - x / tau from rest, integrated by hand
    ramp = np.diff(current) * np.exp(-0.5 * 0.25e-3 / 0.02)
    expected = np.zeros(2001)
    for k in range(1, 2001):
        expected[k] = 0.0 if first[k] else expected[k - 1] * np.exp(-0.25e-3 / 0.02) + ramp[k - 1]
    np.testing.assert_allclose(seen, expected, atol=1e-5 * np.abs(expected).max())  # steps of 1/80 of tau


def test_every_effect_with_states_has_rates_affine_in_each_state_alone(levitation_model):
    nominal = nominal_of(levitation_model)
    v, i, rate = (np.array([x]) for x in (0.05, 0.7, 3.0))
    at = Conditions(nominal, velocity_m_s=v, current_rate_A_s=rate, motional_V=np.array([0.01]))
    for effect in BUILT_IN:
        if effect.memory is None:
            continue
        memory, p = effect.memory, effect.null() | dict.fromkeys(effect.memory.amplitudes, 0.1)

        def rates(levels, memory=memory, p=p):
            states = {name: np.array([z]) for name, z in zip(memory.names, levels, strict=True)}
            rate = memory.rate(states, i, at, p)
            return np.array([float(rate[name][0]) for name in memory.names])

        count = len(memory.names)
        zero = rates(np.zeros(count))
        slopes = np.stack([rates(row) - zero for row in np.eye(count)])
        np.testing.assert_allclose(slopes, np.diag(np.diag(slopes)), atol=1e-12)
        np.testing.assert_allclose(rates(np.full(count, 0.5)) - zero, 0.5 * np.diag(slopes), rtol=1e-9, atol=1e-12)
        assert np.all(np.diag(slopes) <= 0.0)


def record(model, command, step_s):
    """A held body's samples, one of every so many steps of a winding that such commands drive, with noise."""
    time, resistance = step_s / FINER * np.arange(8000 * FINER), model.circuit.resistance_ohm
    volts, kept = command(time), np.exp(-resistance / model.inductance(HELD_M, 0.5) * step_s / FINER)
    current = lfilter([0.0, (1.0 - kept) / resistance], [1.0, -kept], volts)
    here = slice(None, None, FINER)
    columns = {"run": 1.0, "time_s": time[here], "voltage_V": volts[here], "current_A": current[here]}
    return recorded(pd.DataFrame({**columns, "distance_m": HELD_M}), distance_m=0.0)


def levels_from(edge_s):
    """Commands that go between levels so long after a sample."""
    levels = np.array([0.8, 2.4, 1.2, 2.8, 0.6, 2.0])
    return lambda time: levels[(np.floor((time - edge_s) / 0.4 + 1e-6)).astype(int) % len(levels)]


@pytest.fixture(scope="module")
def held_rig(levitation_model):
    """Held: without a motion, whose force would be compared, and without a Hall element."""
    return replace(levitation_model, motion=None, sensor=None)


@pytest.fixture(scope="module")
def at_samples(held_rig):
    return record(held_rig, levels_from(0.0), held_rig.sample_time_s)


def misfit(model, series):
    """Of each window's voltage, over its noise."""
    observations = series_observations(model, series)
    return observations.residual / observations.declared_noise["voltage_balance_V"]


@pytest.mark.parametrize("edge_s", [0.0, 0.185e-3, 0.45e-3])
def test_edges_are_balanced_wherever_they_are_between_two_samples(held_rig, edge_s):
    left = misfit(held_rig, record(held_rig, levels_from(edge_s), held_rig.sample_time_s))
    assert 0.8 < np.sqrt(np.mean(left**2)) < 1.15  # 222 windows: 5 %, and edges at samples make no error
    assert np.abs(left).max() < 4.5


def test_an_edge_still_shows_an_inductance_that_the_model_lacks(held_rig, at_samples):
    longer = replace(held_rig, circuits=(replace(held_rig.circuit, inductance_H=3e-3),))  # 18 % of the winding's own
    assert np.abs(misfit(longer, at_samples)).max() > 4.5


def test_a_command_that_changes_from_sample_to_sample_is_held_between_them(held_rig, at_samples):
    samples = take_samples(held_rig, at_samples)
    volts, held = samples["voltage_V"], held_from(samples, 0)
    scattered = volts + 1e-3 * np.random.default_rng(2).standard_normal(len(volts))
    for command, wanted in ((volts, np.append(np.diff(volts), 0.0) ** 2 / 3.0), (scattered, 0.0 * volts)):
        samples = replace(samples, rows=samples.rows.assign(voltage_V=command))
        mean, error = between_samples(samples, 0, held, held_rig.sample_time_s, command)
        np.testing.assert_array_equal(mean, command)
        np.testing.assert_allclose(error, wanted)


@pytest.mark.parametrize(
    ("drawn", "held", "scatter_V"),
    [(0.1, 0.1, 0.15), (0.5, 1.0, 0.0), (0.5, 1.0, 0.15)],
    ids=["a record that is slow", "a driver slower than drawn", "a scattering driver slower than drawn"],
)
def test_commands_that_a_record_does_not_show_count_as_its_noise(held_rig, drawn, held, scatter_V):
    """Steps that are drawn and steps in which the command is held, over those of the samples."""
    period = held_rig.sample_time_s
    scatter = scatter_V * np.random.default_rng(1).standard_normal(80000)

    def command(time):
        place = np.floor(time / (held * period) + 1e-6).astype(int)
        return 1.6 + 0.4 * np.sin(held * place / 60.0) + scatter[place]

    left = misfit(replace(held_rig, sample_time_s=drawn * period), record(held_rig, command, period))
    assert 0.85 < np.sqrt(np.mean(left**2)) < 1.15


DISTANCE_M, FORCE_N = 2e-6, 0.02


@pytest.mark.nightly
def test_no_reading_is_compared_where_the_body_never_was():
    motion = solenoid().motion
    springy = replace(motion, near_stop=replace(motion.near_stop, restitution=0.6))
    device = replace(solenoid(springy), sample_time_s=STEP_S)
    loop = switched([0.0, 0.01, 0.11], [0.0, 12.0, 0.0], 0.17, model=device)
    assert sum(event.name == "hits_near" for event in loop.events) > 1
    record = logged([loop] * 4, noise=(5e-3, DISTANCE_M))
    force = np.tile(loop.table["force_N"], 4)
    rows = record.rows.assign(force_N=force + FORCE_N * np.random.default_rng(2).standard_normal(len(force)))
    compared = ff.compare(device, replace(record, rows=rows, given=(*record.given, "force_N"))).observations
    for name in ("force_balance_N", "voltage_balance_V", "force_N"):
        distance = compared.column("distance_m")[compared.of(name)]
        assert len(distance) > 40, name
        assert distance.min() >= rows["distance_m"].min(), name
        assert distance.max() <= rows["distance_m"].max(), name
    # Neither the impact nor what came before it is in a mean of the force: what is left is the sensor's noise
    here = compared.of("force_N")
    assert np.abs(compared.value - compared.base)[here].max() < 1.5 * FORCE_N


PERIOD_S = 1e-3


def held(model, seconds=0.7):
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
    seen = flat(model.sensor.field).derivatives(distance, current + induced @ at.coupling[0])[0]
    seen = seen + induced @ at.hall
    here = slice(None, n, FINER)
    noise = model.sensor.noise_V * np.random.default_rng(5).standard_normal(len(volts))
    hall = model.sensor.quiescent_V + model.sensor.sensitivity_V_per_T * seen[here] + noise
    columns = {"time_s": time[here], "voltage_V": volts, "current_A": current[here], "hall_V": hall}
    return pd.DataFrame({"run": 1.0, **columns, "distance_m": HELD_M})


@pytest.fixture(scope="module")
def conducting(levitation_model):
    """Without mass: what holds the body is not recorded. Its iron does not saturate at these currents."""
    drawn = DrawnEffect(KEY, "the conductivity of core", "", 6.0, 0.1, conducts=True)
    circuits = (replace(levitation_model.circuit, voltage_min_V=-50.0, voltage_max_V=50.0),)
    model = replace(with_eddies(levitation_model), motion=None, circuits=circuits)
    return replace(model, drawn=(drawn,), sample_time_s=PERIOD_S)


def test_the_drawing_s_eddy_currents_close_the_balances(conducting):
    exact = recorded(held(conducting), distance_m=0.0, current_A=0.0)
    seen = (series_observations(one, exact) for one in (conducting, replace(conducting, eddy=None, drawn=())))
    left, whole = (one.rms(one.residual) for one in seen)
    assert left["voltage_balance_V"] < 0.02 * whole["voltage_balance_V"]
    assert left["hall_V"] < 0.25 * whole["hall_V"]  # of which noise is left


@pytest.mark.parametrize("share", [0.0, *(pytest.param(share, marks=pytest.mark.nightly) for share in (0.1, -0.1))])
def test_a_lag_that_the_drawing_does_not_predict_is_named_with_its_size(conducting, share):
    found = ff.diagnose(conducting, recorded(held(replace(with_conductivity(conducting, share), motion=None))))
    assert [one.name for one in found.missing] == [KEY] * bool(share)
    if share:
        assert found.missing[0].parameters["change"] == pytest.approx(share, abs=0.01)


def test_a_magnet_without_a_circuit_is_braked_by_what_its_motion_induces():
    """At a constant velocity v each e becomes -lambda' v / R: a force against it of v sum(lambda'^2 / R)."""
    eddy, velocity = eddies((), (2e-3, 5e-3)), 1e-3
    time = np.linspace(0.0, 0.1, 401)
    distance, still = 0.02 + velocity * time, np.zeros((len(time), 1))
    state = MagneticState(np.zeros(401), still, still[..., None], flux_linkage=still)
    induced = Induced.along(eddy, eddy.forms(distance, 0, 1), time, time == 0.0, state)
    slope = induced.rising.flux_linkage[-1]
    assert induced.pull(still)[-1] == pytest.approx(velocity * (slope**2 / eddy.resistances_ohm).sum(), rel=1e-3)
    assert not induced.acting(still).any()


def test_readings_at_an_end_of_an_output_without_a_converter_count_as_missing(model, loops):
    """Without steps a limited output stands next to its end, not on it."""
    analogue = replace(model, sensor=replace(model.sensor, adc_bits=0))
    series = recorded(loops, runs=range(1, 2))
    volts = series.rows["hall_V"]
    limited = np.minimum(volts + 4.999 - volts.median(), 4.999)
    samples = take_samples(analogue, replace(series, rows=series.rows.assign(hall_V=limited)))
    assert np.isnan(samples["hall_V"][limited == 4.999]).all()
    assert np.isfinite(take_samples(analogue, series)["hall_V"]).all()
    assert "clipped" in {finding.code for finding in samples.findings}


SWITCHED = solenoid()


@pytest.fixture(scope="module")
def worn():
    """Logs of a device whose near stop stands 0.1 mm further away."""
    near = SWITCHED.motion.near_stop
    further = replace(near, distance_m=near.distance_m + 0.1e-3)
    device, volts = replace(SWITCHED, motion=replace(SWITCHED.motion, near_stop=further)), [0.0, 12.0, 0.0]
    return logged(
        [
            switched([0.0, 0.02, 0.08], volts, 0.12, model=device),
            switched([0.0, 0.01, 0.07], volts, 0.11, model=device),
        ],
        seed=2,
    )


def test_a_worn_stop_is_named_with_its_size(worn):
    found = ff.diagnose(SWITCHED, worn)
    assert found.missing[0].name == "stop_position"
    added = found.missing[0].parameters["near"] * (SWITCHED.validity.distance_max_m - SWITCHED.validity.distance_min_m)
    assert added == pytest.approx(0.1e-3, abs=0.02e-3)
    free = replace(SWITCHED, motion=replace(SWITCHED.motion, near_stop=None, far_stop=None))
    assert "no stop" in why_untestable(effect_by_name("stop_position"), placed(free, worn))


def test_a_body_that_lies_on_its_stop_while_the_drive_goes_on_lacks_nothing():
    """The noise of its distance would be a motion that induces less voltage, and a gain of -87 % explain noise."""
    turns = 0.025 * np.arange(120)
    loop = switched(turns, np.where(np.arange(120) % 2, 7.0, 12.0), 3.0, start_m=SWITCHED.motion.near_stop.distance_m)
    found = ff.diagnose(SWITCHED, logged([loop], noise=(3e-3, 5e-6)))
    assert found.verdict == "nothing_missing"
    assert found.p_value > 0.01  # a record has no stage whose screw turns: finer patterns would see noise of the rates
