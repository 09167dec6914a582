"""Rows of the study's other experiments: which loops are lost, and by how much a fault moves the body."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from femfit.simulation.experiment import Experiment
from femfit.simulation.loop import LoopResult


@dataclass(frozen=True)
class LossRow:
    """How the runs of one experiment ended.

    Parameters
    ----------
    outcomes : mapping of str to int
        Number of runs by the name of their :class:`~femfit.simulation.outcome.LoopOutcome`.
    last_loss_s : float or None
        When the last of the lost runs was lost.
    estimate_rms_m : float or None
        Over the window, of the runs that were held.
    """

    experiment: Experiment
    runs: int
    outcomes: Mapping[str, int]
    last_loss_s: float | None
    estimate_rms_m: float | None

    @property
    def held(self) -> int:
        """Number of runs that were held."""
        return self.outcomes.get("HELD", 0)


@dataclass(frozen=True)
class ShiftRow:
    """By how much a fault moves estimate and body at rest.

    Parameters
    ----------
    runs, held : int
        Number of repeats, and of those that were held.
    position_shift_m : float
        The same less that of the loop without the fault and with the same noise: what the fault itself does.
    """

    experiment: Experiment
    runs: int
    held: int
    estimate_bias_m: float
    position_bias_m: float
    position_shift_m: float
    shift_error_m: float


def loss_row(experiment: Experiment, result: LoopResult) -> LossRow:
    """Count outcomes."""
    names = [outcome.name for outcome in result.outcomes()]
    held = result.held
    return LossRow(
        experiment=experiment,
        runs=len(names),
        outcomes={name: names.count(name) for name in dict.fromkeys(names)},
        last_loss_s=float(np.nanmax(result.outcome_time_s)) if not held.all() else None,
        estimate_rms_m=float(np.sqrt(np.mean(result.windows[0].estimate_rms_m[held] ** 2))) if held.any() else None,
    )


def shift_row(experiment: Experiment, result: LoopResult, undisturbed: LoopResult) -> ShiftRow:
    """Compare a fault with the loop without it, run by run.

    Parameters
    ----------
    result, undisturbed : LoopResult
        With and without, on the same noise, each with one window of statistics.

    Returns
    -------
    ShiftRow
        Over the runs that were held in both; NaN if there are fewer than two.
    """
    both = result.held & undisturbed.held
    count = int(both.sum())
    window = result.windows[0]
    shift = window.tracking_bias_m[both] - undisturbed.windows[0].tracking_bias_m[both]
    known = count > 1
    return ShiftRow(
        experiment=experiment,
        runs=len(both),
        held=count,
        estimate_bias_m=float(np.mean(window.estimate_bias_m[both])) if known else np.nan,
        position_bias_m=float(np.mean(window.tracking_bias_m[both])) if known else np.nan,
        position_shift_m=float(np.mean(shift)) if known else np.nan,
        shift_error_m=float(np.std(shift, ddof=1) / np.sqrt(count)) if known else np.nan,
    )
