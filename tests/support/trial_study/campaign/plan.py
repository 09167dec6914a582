"""A campaign's plan: which settings are visited in which order, on which mount, at which temperatures."""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray, IntArray
from support.trial_study.truth.bench import Points
from support.trial_study.truth.families import Truth
from support.trial_study.truth.thermal import Temperatures, ThermalNetwork, heat


@dataclass(frozen=True)
class PlanOptions:
    """What a campaign is like.

    Parameters
    ----------
    runs, mounts_per_run : int
        Repeats, and how often the body is put back within one.
    both_signs, both_branches : bool
        Whether negative currents are measured, and whether falling ones are.
    mount_m : float
        Standard deviation of the distance error of a mount.
    """

    runs: int
    mounts_per_run: int
    distances: int
    currents: int
    both_signs: bool
    both_branches: bool
    mount_m: float
    step_s: float
    network: ThermalNetwork


@dataclass(frozen=True, eq=False)
class Plan:
    """A campaign's readings to be taken.

    Parameters
    ----------
    distance, current : array, shape (n,)
        On the dials, in m and A.
    run, mount, order : array of int, shape (n,)
        From 0; ``order`` over the whole campaign.
    branch : array, shape (n,)
        +1 or -1.
    time_s : array, shape (n,)
        Within the run.
    remount : array, shape (n,)
        Distance error of each reading's mount in m.
    """

    distance: FloatArray
    current: FloatArray
    run: IntArray
    mount: IntArray
    order: IntArray
    branch: FloatArray
    time_s: FloatArray
    temperatures: Temperatures
    remount: FloatArray

    def points(self, remounts: bool = True) -> Points:
        """What body and winding have, with or without the errors of the mounts."""
        return Points(
            distance=self.distance + self.remount if remounts else self.distance,
            current=self.current,
            run=self.run,
            order=self.order,
            time_s=self.time_s,
            branch=self.branch,
            coil_C=self.temperatures.coil,
            magnet_C=self.temperatures.magnet,
            element_C=self.temperatures.element,
        )


def drawn_options(truth: Truth, generator: np.random.Generator) -> PlanOptions:
    """Draw what a campaign is like: 300 to 3,000 rows."""
    signed = truth.actuator.sweep.currents_A[0] < 0.0 or bool(generator.random() < 0.5)
    branches = bool(generator.random() < 0.5)
    runs = int(generator.integers(2, 6))
    rows = float(np.exp(generator.uniform(np.log(330.0), np.log(2800.0))))
    per_distance = rows / runs
    currents = int(np.clip(round(generator.uniform(0.4, 0.8) * np.sqrt(per_distance)), 4, 13))
    cycle = currents * (2 if branches else 1)
    return PlanOptions(
        runs=runs,
        mounts_per_run=int(generator.choice([1, 1, 2, 3])),
        distances=int(np.clip(round(per_distance / cycle), 6, 40)),
        currents=currents,
        both_signs=signed,
        both_branches=branches,
        mount_m=float(generator.uniform(0.0, 50e-6)),
        step_s=float(generator.uniform(2.0, 12.0)),
        network=ThermalNetwork(
            rise_K=float(generator.uniform(10.0, 40.0)),
            coil_s=float(generator.uniform(300.0, 900.0)),
            magnet_s=float(generator.uniform(600.0, 2000.0)),
            element_s=float(generator.uniform(60.0, 400.0)),
            magnet_share=float(generator.uniform(0.3, 0.7)),
            element_share=float(generator.uniform(0.5, 0.9)),
            ambient_C=float(generator.uniform(18.0, 25.0)),
        ),
    )


def make_plan(truth: Truth, options: PlanOptions, generator: np.random.Generator) -> Plan:
    """Lay out a campaign.

    Returns
    -------
    Plan
        Runs one after the other; within one the distances in order or shuffled, at each the current's cycle.
    """
    grid = _distances(truth, options.distances)
    largest = max(map(abs, truth.actuator.sweep.currents_A))
    rising = np.linspace(-largest if options.both_signs else 0.0, largest, options.currents)
    cycle = np.concatenate([rising, rising[::-1]]) if options.both_branches else rising
    direction = np.repeat([1.0, -1.0], len(rising)) if options.both_branches else np.ones(len(rising))
    shuffled = bool(generator.random() < 0.3)
    distance, mount = [], []
    for number in range(options.runs):
        places = generator.permutation(options.distances) if shuffled else np.arange(options.distances)
        distance.append(np.repeat(grid[places], len(cycle)))
        part = np.arange(options.distances) * options.mounts_per_run // options.distances
        mount.append(np.repeat(number * options.mounts_per_run + part, len(cycle)))
    n = options.distances * len(cycle)
    run: IntArray = np.repeat(np.arange(options.runs), n)
    current = np.tile(cycle, options.distances * options.runs)
    ambient = options.network.ambient_C + generator.normal(0.0, 2.0, options.runs)
    errors = generator.normal(0.0, options.mount_m, options.runs * options.mounts_per_run)
    order = np.arange(n * options.runs)
    joined = np.concatenate(mount)
    return Plan(
        distance=np.concatenate(distance),
        current=current,
        run=run,
        mount=joined,
        order=order,
        branch=np.tile(direction, options.distances * options.runs),
        time_s=(options.step_s * (order - n * run)).astype(np.float64),
        temperatures=heat(options.network, current, run, ambient[run], options.step_s),
        remount=errors[joined],
    )


def _distances(truth: Truth, count: int) -> FloatArray:
    """Distances of a run, closer together where the force changes more, off the sweep's border by some mount errors."""
    low, high = truth.actuator.sweep.distances_m[0], truth.actuator.sweep.distances_m[-1]
    margin = 0.02 * (high - low)
    even = np.linspace(low + margin, high - margin, count)
    close = np.geomspace(low + margin, high - margin, count)
    return np.round(0.5 * (even + close), 6)
