"""What a fault does to a loop: which runs are lost, and by how much estimate and body move."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from femfit.simulation.experiment import Experiment
from femfit.simulation.loop import LoopResult


@dataclass(frozen=True)
class FaultRow:
    """How the runs of one experiment ended, with the means of those that were held.

    Parameters
    ----------
    outcomes : mapping of str to int
        Number of runs by the name of their :class:`~femfit.simulation.outcome.LoopOutcome`.
    last_loss_s : float or None
        When the last of the lost runs was lost.
    estimate_rms_m, estimate_bias_m, position_bias_m : float
        Estimated minus true distance, and true distance minus reference; NaN if no run was held.
    position_shift_m, shift_error_m : float
        How far the body moved against the loop without the fault on the same noise, and the standard error of that;
        NaN without such a loop, or if fewer than two runs were held in both.
    """

    experiment: Experiment
    runs: int
    outcomes: Mapping[str, int]
    last_loss_s: float | None
    estimate_rms_m: float
    estimate_bias_m: float
    position_bias_m: float
    position_shift_m: float
    shift_error_m: float

    @property
    def held(self) -> int:
        """Number of runs that were held."""
        return self.outcomes.get("HELD", 0)


def fault_row(experiment: Experiment, result: LoopResult, undisturbed: LoopResult | None = None) -> FaultRow:
    """Sum up the first window of an experiment.

    Parameters
    ----------
    undisturbed : LoopResult or None
        The same loop on the same noise without the fault, to compare with run by run.
    """
    names = [outcome.name for outcome in result.outcomes()]
    held, window = result.held, result.windows[0]
    shift = shift_error = float("nan")
    if undisturbed is not None and np.sum(both := held & undisturbed.held) > 1:
        moved = window.tracking_bias_m[both] - undisturbed.windows[0].tracking_bias_m[both]
        shift, shift_error = float(np.mean(moved)), float(np.std(moved, ddof=1) / np.sqrt(len(moved)))
    squares, estimate, position = (
        float(np.mean(values[held])) if held.any() else float("nan")
        for values in (window.estimate_rms_m**2, window.estimate_bias_m, window.tracking_bias_m)
    )
    return FaultRow(
        experiment=experiment,
        runs=len(names),
        outcomes={name: names.count(name) for name in dict.fromkeys(names)},
        last_loss_s=float(np.nanmax(result.outcome_time_s)) if not held.all() else None,
        estimate_rms_m=float(np.sqrt(squares)),
        estimate_bias_m=estimate,
        position_bias_m=position,
        position_shift_m=shift,
        shift_error_m=shift_error,
    )
