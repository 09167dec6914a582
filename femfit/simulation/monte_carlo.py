"""Many repeats of one closed loop, summed up while they run: nothing is stored but what is asked for."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.filters.consistency import ConsistencyBand, consistency_band
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.design import SUPPORT_TIME_CONSTANTS, LoopDesign
from femfit.simulation.experiment import Experiment, run_experiments
from femfit.simulation.loop import LoopResult


@dataclass(frozen=True)
class Spread:
    """Of a number over the runs that were held.

    Parameters
    ----------
    median, upper : float
        50 % and 95 % quantile; NaN if no run was held.
    """

    median: float
    upper: float


@dataclass(frozen=True)
class MonteCarloSummary:
    """What many runs came to.

    Parameters
    ----------
    runs, steps : int
        How many, and samples of each.
    outcomes : mapping of str to int
        Runs by the name of their outcome.
    first_loss_s, last_loss_s : float or None
        When runs were lost, where any was.
    estimate_rms_m, tracking_rms_m : Spread
        Of each run's rms of (estimated - true distance) and of (true distance - reference), of held runs.
    normalised_innovation_squared : float or None
        Mean over held runs; None without a filter.
    innovation_band : ConsistencyBand
        95 % for that mean.
    """

    experiment: Experiment
    runs: int
    steps: int
    outcomes: Mapping[str, int]
    first_loss_s: float | None
    last_loss_s: float | None
    estimate_rms_m: Spread
    tracking_rms_m: Spread
    normalised_innovation_squared: float | None
    innovation_band: ConsistencyBand


def monte_carlo(
    design: LoopDesign,
    experiment: Experiment,
    random: np.random.Generator,
    *,
    runs: int = 1000,
    duration_s: float = 1.0,
    recorded: int = 0,
    plant: ActuatorModel | None = None,
) -> tuple[MonteCarloSummary, LoopResult]:
    """Repeat a closed loop with different noise.

    Parameters
    ----------
    plant : ActuatorModel or None
        What truly moves, where that is another model than the design's.
    """
    steps = max(1, round(duration_s / design.model.sample_time_s))
    supported = 0 if experiment.believed_m is not None else design.steps(SUPPORT_TIME_CONSTANTS)
    (result,) = run_experiments(
        design,
        [experiment],
        random,
        runs=runs,
        steps=steps,
        windows=(slice(0, steps),),
        supported_steps=supported,
        recorded=recorded,
        plant=plant,
    )
    names = [outcome.name for outcome in result.outcomes()]
    held, statistics = result.held, result.windows[0]
    quality = statistics.normalised_innovation_squared[held]
    summary = MonteCarloSummary(
        experiment=experiment,
        runs=runs,
        steps=steps,
        outcomes={name: names.count(name) for name in dict.fromkeys(names)},
        first_loss_s=None if held.all() else float(np.nanmin(result.outcome_time_s)),
        last_loss_s=None if held.all() else float(np.nanmax(result.outcome_time_s)),
        estimate_rms_m=_spread(statistics.estimate_rms_m[held]),
        tracking_rms_m=_spread(statistics.tracking_rms_m[held]),
        normalised_innovation_squared=float(quality.mean()) if np.isfinite(quality).any() else None,
        innovation_band=consistency_band(max(1, int(held.sum())) * steps),
    )
    return summary, result


def _spread(values: FloatArray) -> Spread:
    if not values.size:
        return Spread(float("nan"), float("nan"))
    return Spread(*(float(q) for q in np.quantile(values, (0.5, 0.95))))
