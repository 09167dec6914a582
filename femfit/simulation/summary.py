"""What is said of closed loops: of one in numbers, of many runs of one, and of all controllers over the same steps.

Recorded runs of a loop as a table: one row a sample, up to the sample at which a run was lost.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.files import LOOP, path_of, require_outputs
from femfit.core.numerics import FloatArray
from femfit.core.results import Finding, Plotted, Result, attributes
from femfit.core.sweep_columns import circuit_currents
from femfit.estimate.noise import ConsistencyBand, consistency_band
from femfit.simulation.constants import UNCERTAIN
from femfit.simulation.controllers import ControllerName
from femfit.simulation.design import CONTROLLERS, JudgedLoop, LoopDesign, ObserverName
from femfit.simulation.experiment import Cause, Experiment, LoopRuns, why_lost
from femfit.simulation.loop import LoopOutcome, LoopResult
from femfit.simulation.margins import Margins
from femfit.simulation.open_result import write_table
from femfit.simulation.words import finding, sentence


def design_data(design: LoopDesign, loops: Sequence[JudgedLoop]) -> dict[str, Any]:
    """What programs read of reference, gains, margins and operating points."""
    pid, feedback = (None if design.why_no(name) else design.controller(name) for name in ("pid", "state-feedback"))
    facts = attributes(design, "sensors", "noise", "latency_samples=latency", "targets_m", "reference_rate_rad_s")
    return facts | {
        "backstepping": design.controller("backstepping"),
        "pid": pid,
        "no_pid": design.why_no("pid"),
        "state_feedback": feedback,
        "no_state_feedback": design.why_no("state-feedback"),
        "margins": [
            {"controller": loop.controller, "observer": loop.observer, **vars(loop.margins)}
            for loop in loops
            if loop.margins is not None
        ],
        "points": design.points,
    }


def series_table(design: LoopDesign, result: LoopResult) -> pd.DataFrame:
    """The recorded runs of a loop, one row a sample, up to the sample at which a run was lost.

    Commands have the circuits' names where there are several. Readings are columns of a record, from which any filter
    takes them; what no sensor gives is named as the truth or an estimate.
    """
    series, circuits = result.series, design.model.circuits
    readings, currents = [each.reading for each in design.loop_sensors()], circuit_currents(design.model.circuit_names)
    kinds = ["command{}_A" if circuit.drive.kind == "current" else "voltage{}_V" for circuit in circuits]
    commands = [
        kind.format(f"_{circuit.name}" if len(circuits) > 1 else "")
        for kind, circuit in zip(kinds, circuits, strict=True)
    ]
    names = [
        *commands,
        *(f"true_{name}" for name in currents),
        "true_distance_m",
        *(r.column or f"{r.name}_{r.unit.replace('/', '_').replace('^', '')}" for r in readings),
        *("reference_m", "estimated_distance_m", "estimated_velocity_m_s"),
        *(f"estimated_{name}" for name in currents),
    ]
    true = [series.commands, series.currents_A, series.distance_m, series.readings, series.reference_m]
    estimated = [series.estimated_distance_m, series.estimated_velocity_m_s, series.estimated_currents_A]
    values, (steps, runs) = np.dstack([*true, *estimated]), series.distance_m.shape
    table = pd.DataFrame(values.transpose(1, 0, 2).reshape(-1, len(names)), columns=names)
    table.insert(0, "time_s", np.tile(result.time_s, runs))
    table.insert(0, "run", np.repeat(np.arange(1, runs + 1), steps))
    return table[np.isfinite(table["true_distance_m"])]


@dataclass(frozen=True)
class Spread:
    """Median and 95 % quantile of a number over the runs that were held; NaN if none was."""

    median: float
    upper: float

    @classmethod
    def of(cls, values: FloatArray) -> "Spread":
        """Of a number for each run that was held."""
        return cls(*np.quantile(values, (0.5, 0.95)).tolist()) if values.size else cls(np.nan, np.nan)


CERTAIN = 30.0
"""Derived: growth times duration from which a deviation of one rounding, 1e-13 of the range, has grown to the range."""


@dataclass(frozen=True)
class Choice:
    """Why a controller was taken: the worst margins of each, the best first, and those before it that lost runs."""

    margins: Mapping[ControllerName, Margins]
    lost: tuple[ControllerName, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class LoopSummary(Plotted, Result):
    """What many runs of one closed loop came to; printed, it says so in a few lines.

    Parameters
    ----------
    plant : str or None
        Name of what truly moves, where that is another model than the design's.
    outcomes : mapping of str to int
        Runs by the name of their outcome.
    first_loss_s, last_loss_s : float or None
        When runs were lost, where any was.
    estimate_rms_m, tracking_rms_m : Spread
        Of each run's rms of (estimated - true distance) and of (true distance - reference).
    normalised_innovation_squared : float or None
        Mean over held runs; None without a filter.
    innovation_band : ConsistencyBand
        95 % for that mean.
    cause : Cause or None
        Why runs were lost, by its code and numbers; None where all were held.
    result : LoopResult
        Outcome of each run, and the series of those that were recorded.
    choice : Choice or None
        Why this controller was taken; None where it was asked for.

    Examples
    --------
    >>> import femfit as ff
    >>> loop = ff.close_loop("model.json", controller="backstepping", targets_m=(0.022,), runs=2, seconds=0.1)
    >>> loop.held, loop.result.series.distance_m.shape
    (2, (200, 1))
    """

    finite = True
    data = (
        *("model=design.model.name", "experiment", "plant", "runs", "steps", "outcomes", "first_loss_s", "last_loss_s"),
        *("estimate_rms_m", "tracking_rms_m", "normalised_innovation_squared", "innovation_band", "cause", "choice"),
        *("findings", "design=designed"),
    )

    design: LoopDesign
    experiment: Experiment
    plant: str | None
    runs: int
    steps: int
    outcomes: Mapping[str, int]
    first_loss_s: float | None
    last_loss_s: float | None
    estimate_rms_m: Spread
    tracking_rms_m: Spread
    normalised_innovation_squared: float | None
    innovation_band: ConsistencyBand
    cause: Cause | None
    result: LoopResult
    choice: Choice | None = None
    findings: tuple[Finding, ...] = ()  # What is remarked on the runs that were held

    @classmethod
    def of(cls, loop: LoopRuns, result: LoopResult, *, advised: bool) -> "LoopSummary":
        """Sum up runs; where it is advised, trials find out why some of them are lost."""
        held = result.held
        lost_s = result.outcome_time_s[~held].tolist()
        read = np.where(held, result.readings, 0.0)
        total = int(read.sum())
        squared = float(np.nansum(result.normalised_innovation_squared * read)) / total if total else None
        tracking = Spread.of(result.tracking_rms_m[held])
        findings = []
        if held.any() and loop.plant is None and (growths := loop.growths) > 1.0:
            growth, grown = loop.growth_per_s(), growths > CERTAIN
            findings.append(
                finding("limit-cycle", size=growth, growth_per_s=growth, grown=grown, tracking_rms_m=tracking.median)
            )
        margins = loop.design.judged(loop.experiment.controller, loop.experiment.observer).margins
        if margins is not None and margins.stable and not margins.uses_sensors:
            findings.append(
                finding("unused-sensors", size=margins.largest_gain, margins=margins, model=loop.design.model)
            )
        if squared is not None and squared > UNCERTAIN:
            findings.append(finding("innovations", size=squared, excess=squared))
        return cls(
            design=loop.design,
            experiment=loop.experiment,
            plant=loop.plant.name if loop.plant is not None else None,
            runs=loop.runs,
            steps=loop.steps,
            outcomes=Counter(LoopOutcome(code).name for code in result.outcome.tolist()),
            first_loss_s=min(lost_s, default=None),
            last_loss_s=max(lost_s, default=None),
            estimate_rms_m=Spread.of(result.estimate_rms_m[held]),
            tracking_rms_m=tracking,
            normalised_innovation_squared=squared,
            innovation_band=consistency_band(max(1, total)),
            cause=why_lost(loop, result) if lost_s and advised else None,
            result=result,
            findings=tuple(findings),
        )

    @property
    def held(self) -> int:
        """Number of runs that were held."""
        return self.outcomes.get(LoopOutcome.HELD.name, 0)

    @property
    def advice(self) -> str:
        """Why runs were lost and what to do; empty where all were held."""
        return sentence("lost", "advice", self, self.cause) if self.cause else ""

    @property
    def judged(self) -> JudgedLoop:
        """The linear loop."""
        return self.design.judged(self.experiment.controller, self.experiment.observer)

    def __str__(self) -> str:
        return "\n\n".join([sentence("loop", "summary", self), sentence("loop", "design", self.design, [self.judged])])

    @property
    def designed(self) -> dict[str, Any]:
        """What programs read of the design and the linear loop."""
        return design_data(self.design, [self.judged])

    def write_csv(self, path: str | Path) -> None:
        """Write the recorded runs, one row a sample, up to the sample at which a run was lost."""
        require_outputs([], (path_of(path, "The table of the runs"), LOOP))
        write_table(path, series_table(self.design, self.result))


FILTER: ObserverName = "ukf"
"""That a study of all controllers looks at."""


@dataclass(frozen=True)
class StepRow:
    """How well one measurement follows the true distance over the reference steps."""

    controller: str
    measurement: str  # ``direct`` or the filter that feeds the loop
    rms_m: float  # Over the runs that were held; NaN if none was
    held: int
    runs: int


@dataclass(frozen=True, eq=False, repr=False)
class ClosedLoopStudy(Plotted, Result):
    """Everything that command line, report and run show of the closed loop."""

    finite = True

    design: LoopDesign
    seed: int
    loops: tuple[LoopSummary, ...]  # One a controller, all of its runs recorded
    steps: tuple[StepRow, ...]

    def __str__(self) -> str:
        design = self.design
        sections = [
            sentence("study", "held", self, [why for name in CONTROLLERS if (why := design.why_no(name))]),
            sentence("study", "steps", self),
            sentence("study", "design", self, self._judged),
        ]
        return "\n\n".join(sections)

    @property
    def _judged(self) -> list[JudgedLoop]:
        return [self.design.judged(name, FILTER) for name in self.design.controllers]

    @property
    def data(self) -> dict[str, Any]:
        """What programs read, without time series."""
        facts = attributes(self, "model=design.model.name", "seed", "no_direct=design.why_no_direct")
        return facts | design_data(self.design, self._judged) | {"steps": self.steps}
