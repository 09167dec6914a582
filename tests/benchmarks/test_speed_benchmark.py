"""What femfit's parts take: filters, loops, diagnoses, sweeps, commands.

Run with ``python -m pytest -m benchmark -s tests/benchmarks``. Times are printed, of the processor where none is named;
none is asserted.
"""

import os
import resource
import statistics
import sys
import time
from dataclasses import replace

import ngsolve
import numpy as np
import pandas as pd
import pytest
from arpaia2022.sensors import PAPER_SAMPLE_RATE
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

import femfit as ff
from femfit.device.drawn_numbers import read_numbers
from femfit.device.load import read_actuator
from femfit.effects.catalogue import effect_by_name
from femfit.estimate.holding import holding_currents
from femfit.estimate.kalman_filter import kalman_filter
from femfit.estimate.moments import ExtendedFilter, UnscentedFilter
from femfit.field.point_rows import swept_currents
from femfit.field.sweep_task import mesh_groups, problem_of
from femfit.field.tolerance import settings_for
from femfit.identify.bench import placed
from femfit.identify.decision.campaign import considered_effects, gather
from femfit.identify.decision.diagnose import diagnose, diagnose_observations
from femfit.model.bspline import DistanceCoordinate
from femfit.model.carried import FieldTerm
from femfit.model.drawn_effect import DrawnEffect, parameter_name
from femfit.model.hall import HallSpline
from femfit.model.magnetics import CoenergySpline
from femfit.model.with_effects import with_effects
from femfit.simulation.close_loop import closed_loop_study, run_loops
from femfit.simulation.design import design_loop
from femfit.simulation.experiment import Experiment
from support.actuators import GEOMETRY
from support.added_effects import added, usual
from support.campaign import campaign
from support.closed_loop import closed_loop, recorded
from support.command import FEMFIT
from support.eddies import with_eddies
from support.levitation import REFERENCE_DISTANCE, fitted_spline
from support.replays import damped, logs
from support.solenoids import solenoid
from support.timed_sweep import SWEEPS, processor_seconds, timed, timed_sweep

pytestmark = pytest.mark.benchmark

FILTERS = [UnscentedFilter, ExtendedFilter]


def seconds(work, times=1, clock=time.process_time):
    """What the work gives, and its time, the median of several."""
    spent = []
    for _ in range(times):
        start = clock()
        result = work()
        spent.append(clock() - start)
    return result, statistics.median(spent)


def alternating(title, steps, turns=20, count=5):
    """Print median microseconds a step of each, in turns, so that what else the machine does meets all of them."""
    times = {name: [] for name in steps}
    for _ in range(turns):
        for name, step in steps.items():
            _, spent = seconds(lambda step=step: [step() for _ in range(count)])
            times[name].append(1e6 * spent / count)
    medians = ", ".join(f"{name} {statistics.median(values):.0f}" for name, values in times.items())
    print(f"\n{title}, us a step: {medians}")


def a_filterpy_step(order):
    """One step of the peer's filter with a linear model and one measurement."""
    points = MerweScaledSigmaPoints(order, alpha=1.0, beta=2.0, kappa=0.0)
    peer = UnscentedKalmanFilter(dim_x=order, dim_z=1, dt=5e-4, hx=lambda x: x[:1], fx=lambda x, _dt: x, points=points)
    peer.Q, peer.R = 1e-6 * np.eye(order), np.array([[1e-4]])

    def step():
        peer.predict()
        peer.update(np.zeros(1))

    return step


def a_femfit_step(model, order, runs, kind=UnscentedFilter):
    """One step of our filter with the model's co-energy and Hall field."""
    current = holding_currents(model, 0.022)[0]
    filter_ = kind(kalman_filter(model, hall_bias=order == 4).process)
    states = [filter_.start(np.array([0.022, 0.0, current]), runs=runs)]
    reading = np.full(runs, float(model.sensor.voltage(np.asarray(0.022), np.asarray(current))))
    voltage = model.circuit.resistance_ohm * current

    def step():
        states[0] = filter_.step(states[0], voltage, reading)
        assert not states[0].diverged.any()

    return step


@pytest.mark.parametrize("order", [3, 4])
def test_one_filter_and_a_thousand_beside_filterpy(levitation_model, order):
    steps = {"filterpy": a_filterpy_step(order)}
    steps |= {f"{runs} at once": a_femfit_step(levitation_model, order, runs) for runs in (1, 1000)}
    steps |= {"1000 extended": a_femfit_step(levitation_model, order, 1000, ExtendedFilter)}
    alternating(f"{order} states", steps, 40, 3)


@pytest.mark.parametrize("kind", FILTERS)
def test_one_filter_of_a_model_with_effects_or_eddy_currents(levitation_model, kind):
    chosen = ((), ("core_saturation",), ("core_saturation", "eddy_current_lag"), ("hysteresis",))
    models = {
        "+".join(names) or "none": with_effects(
            levitation_model, [usual(effect_by_name(name), 1.0 / 3.0) for name in names]
        )
        for names in chosen
    }
    models["three eddy currents"] = with_eddies(levitation_model)
    steps = {name: a_femfit_step(model, 3, 1, kind) for name, model in models.items()}
    steps |= {f"1000 of {name}": a_femfit_step(models[name], 3, 1000, kind) for name in ("none", "three eddy currents")}
    alternating(kind.__name__, steps)


@pytest.mark.parametrize("observer", ["ukf", "ukf4", "ekf", "direct"])
def test_a_thousand_loops_of_one_second(levitation_model, observer):
    design = design_loop(levitation_model)
    experiment = Experiment("backstepping", observer, design.targets_m)
    summary, wall = seconds(
        lambda: run_loops(design, [experiment], np.random.default_rng(1), runs=1000, duration_s=1.0)[0],
        clock=time.perf_counter,
    )
    print(f"\n1000 loops of {summary.steps} steps, {observer}: {wall:.1f} s on the wall", dict(summary.outcomes))
    assert sum(summary.outcomes.values()) == 1000


WORK = {
    "closed-loop study": lambda rig: closed_loop_study(rig).steps,
    "100 ms of a solenoid with one pull-in": lambda _: ff.simulate(solenoid(), voltage_V=12.0).switchings,
    "20,000 samples with the search for the noise": lambda _: ff.observe(damped(), logs(20_000, 1, seed=7)[1][0]).noise,
}


@pytest.mark.parametrize("label", WORK)
def test_whole_commands_of_simulation_and_estimate(label, levitation_model):
    result, spent = seconds(lambda: WORK[label](levitation_model))
    print(f"\n{label}: {spent:.2f} s")
    assert result


@pytest.mark.parametrize("name", ["ukf", "ekf"])
def test_samples_a_second_of_one_filter_over_a_record(name):
    """A million samples in 50 s is the aim, 20,000 a second."""
    runs = logs(8000, 25, seed=7)[1]
    rows = pd.concat([one.rows.assign(run=k + 1.0, segment=k) for k, one in enumerate(runs)], ignore_index=True)
    record = replace(runs[0], rows=rows)
    found, spent = seconds(lambda: ff.observe(damped(), record, filter=name, find=False))
    print(f"\n{name}: {len(rows) / spent:,.0f} samples a second")
    assert found.filters[0].replayed.mean.shape == (len(rows), 3)


def test_forty_thousand_samples_with_all_effects(levitation_model):
    model = replace(levitation_model, sample_time_s=1e-3)
    friction = added("viscous_friction", damping_per_s=3.0)
    record = recorded(closed_loop(model, [friction], runs=10, seconds=4.0, seed=1), runs=range(1, 11))
    result, spent = seconds(lambda: diagnose(model, record), 3)
    scored = sum(not score.note for score in result.ranking)
    print(f"{len(record.rows)} samples, {scored} effects: {spent:.1f} s (60 s required)")
    assert "viscous_friction" in result.missing[0].members


def drawn(k):
    """A number of a drawing: 0.2 % of W' a millimetre, as a decay of its own times a power of the current."""
    power, length, currents = k % 3, 0.006 + 0.001 * k, np.linspace(0.0, 1.4, 8)

    def decay(d):
        return np.exp(-(d - REFERENCE_DISTANCE) / length)

    coenergy = fitted_spline(lambda d, i: (2e-6, 6e-4, 6e-4)[power] * decay(d) * i**power, currents, 2)
    hall = fitted_spline(lambda d, i: 1e-4 * decay(d) + 0.0 * i, currents, 1)
    u = DistanceCoordinate(REFERENCE_DISTANCE)
    term = FieldTerm(parameter_name("mm"), coenergy=CoenergySpline(u, coenergy), hall=HallSpline(u, hall))
    return DrawnEffect(f"part{k}.r_mm[0]", f"part{k}.r_mm[0]", "mm", 10.0, 0.1, (term,))


def test_a_thousand_rows_with_all_effects_and_twenty_numbers(levitation_model):
    """Asked are 3 s."""
    model = replace(levitation_model, drawn=tuple(drawn(k) for k in range(20)))
    hidden = [added("core_saturation", mmf_loss_6=0.02)]
    observations = placed(model, campaign(model, 1, hidden, distances=15, currents=11))
    effects = considered_effects((), observations.nominal)
    result, whole = seconds(lambda: diagnose_observations(model, observations), 3)
    assert result.missing[0].name == "core_saturation"
    gathered = gather(observations, effects)
    print(
        f"\n{len(observations.covariates)} rows x {len(observations.channels)} channels, {len(gathered.effects)} "
        f"variants: {whole:.1f} s (3 s asked)"
    )


@pytest.mark.parametrize("label", SWEEPS)
def test_whole_sweep_command(label, tmp_path):
    walls, counts = zip(*(timed_sweep(label, tmp_path / str(repeat)) for repeat in range(5)), strict=True)
    assert len(set(counts)) == 1
    peak, wall = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0, statistics.median(walls)
    print(
        f"\nfemfit sweep, {label}, {counts[0]} points, 2 processes, imports included: {wall:.2f} s on the wall "
        f"({min(walls):.2f} to {max(walls):.2f}); peak memory of the largest process {peak:.0f} MB"
    )


@pytest.mark.parametrize("name", ["emaws-rig", "ball", "voice-coil", "solenoid"])
def test_signatures_beside_the_plain_sweep(name):
    ngsolve.SetNumThreads(1)  # as the sweep's workers do
    path = GEOMETRY / f"{name}.toml"
    actuator, numbers = read_actuator(path), read_numbers(path)
    currents, spent = swept_currents(actuator.sweep), np.zeros(2)
    meshes = [*mesh_groups(actuator, settings_for(actuator)).items()]
    for distance, mesh in meshes[:: max(1, len(meshes) // 12)]:  # evenly spread over it
        problem, meshing = seconds(lambda mesh=mesh: problem_of(mesh))
        _, plain = seconds(lambda at=distance, problem=problem: problem.rows(at, currents))
        _, more = seconds(lambda at=distance, problem=problem: problem.signatures(at, currents, numbers))
        spent += meshing + plain, more
    print(f"\n{name}: {len(numbers)} numbers: sweep {spent[0]:.1f} s, signatures {spent[1]:.1f} s more")


SAMPLES = int(os.environ.get("FEMFIT_BENCHMARK_SAMPLES", "225280000"))
BLOCK = 2**18


@pytest.mark.parametrize("method", ["ffa2", "cs1-offset"])
def test_whole_integrate_command(method, tmp_path):
    """The paper's longest record: 1,100 s at 204.8 kS/s, 225 million samples of voltage and Hall probe, 1.8 GB.

    FEMFIT_BENCHMARK_SAMPLES makes it shorter.
    """
    # Voltage and Hall probe at rest in 1 T
    rows = (7e-6, 1.0) + (1.6e-5, 1.6e-4) * np.random.default_rng(0).normal(size=(BLOCK, 2))
    with (tmp_path / "coil.bin").open("wb") as file:
        for _ in range(SAMPLES // BLOCK):
            rows.astype("<f4").tofile(file)
    side = f'sample_rate_Hz = {PAPER_SAMPLE_RATE}\ncolumns = ["coil_voltage_V", "hall_T"]\n'
    (tmp_path / "coil.toml").write_text(side)
    command = [FEMFIT, "integrate", str(tmp_path / "coil.bin"), "--coil-area", "0.059394", "--method", method]
    wall, cpu = processor_seconds(lambda: timed([*command, "-o", str(tmp_path / "out.parquet")]))
    print(
        f"\nfemfit integrate {method}, {SAMPLES / 1e6:.0f} million samples from file to file: "
        f"{wall:.0f} s ({cpu:.0f} s of CPU, one core), {SAMPLES / wall / 1e6:.1f} million samples a second"
    )


def test_time_until_femfit_can_be_used():
    commands = {"nothing": "pass", "import femfit": "import femfit"}
    walls = {name: [timed([sys.executable, "-c", code]) for _ in range(9)] for name, code in commands.items()}
    walls["femfit --help"] = [timed([FEMFIT, "--help"]) for _ in range(9)]
    print("\n", ", ".join(f"{name} {statistics.median(one):.3f} s" for name, one in walls.items()), "on the wall")
