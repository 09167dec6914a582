"""Which loops of a model hold, and how well they measure: every controller over the reference steps, on the same noise.

The direct measurement is taken from the same readings as the filter's: root mean square of measured minus true distance
over the whole run.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.files import json_ready
from femfit.core.results import Plotted
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.close_loop import run_loops
from femfit.simulation.design import CONTROLLERS, JudgedLoop, LoopDesign, ObserverName, design_loop
from femfit.simulation.experiment import Experiment, direct_distance
from femfit.simulation.loop import LoopProgress
from femfit.simulation.summary import LoopSummary, design_data
from femfit.simulation.words import sentence

FILTER: ObserverName = "ukf"

RUNS = 8
"""Conventional: repeats of the reference steps."""


@dataclass(frozen=True)
class StepRow:
    """How well one measurement follows the true distance over the reference steps."""

    controller: str
    measurement: str  # ``direct`` or the filter that feeds the loop
    rms_m: float  # Over the runs that were held; NaN if none was
    held: int
    runs: int


@dataclass(frozen=True, eq=False, repr=False)
class ClosedLoopStudy(Plotted):
    """Everything that command line, report and run show of the closed loop."""

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

    def data(self) -> dict[str, Any]:
        """The numbers without time series, ready for JSON; what does not exist is null."""
        return {
            "model": self.design.model.name,
            "seed": self.seed,
            "no_direct": self.design.why_no_direct,
            **design_data(self.design, self._judged),
            "steps": [json_ready(asdict(row)) for row in self.steps],
        }


def closed_loop_study(
    model: ActuatorModel,
    seed: int = 1,
    noise: Mapping[str, float] | float | None = None,
    *,
    sensors: Sequence[str] | None = None,
    progress: LoopProgress | None = None,
) -> ClosedLoopStudy:
    """Run the study.

    Parameters
    ----------
    noise : mapping of str to float, float or None
        White noise of one sample by the sensors' names, or that of the first; the model's where None.
    sensors : sequence of str or None
        Which of the model's sensors the loops read; the Hall element, or all where there is none.
    progress : callable or None
        Called with what is simulated, the samples done and all of them, now and then.
    """
    design = design_loop(model, noise, sensors=sensors)
    if not design.controllers:
        raise DomainError(" ".join(design.why_no(name) for name in CONTROLLERS))
    samples = len(design.targets_m) * math.ceil(design.step_s / design.model.sample_time_s)
    experiments = [Experiment(name, FILTER, design.targets_m) for name in design.controllers]
    options: dict[str, Any] = {"runs": RUNS, "recorded": RUNS, "advised": False, "progress": progress}
    duration = samples * design.model.sample_time_s
    loops, rows = run_loops(design, experiments, np.random.default_rng(seed), duration_s=duration, **options), []
    for loop in loops:
        held, series = loop.result.held, loop.result.series
        measured = {} if design.why_no_direct else {"direct": direct_distance(design, series)}
        for measurement, distance in (measured | {FILTER: series.estimated_distance_m}).items():
            errors = (distance - series.distance_m)[:, held]
            rms = float(np.sqrt(np.mean(errors**2))) if errors.size else float("nan")
            rows.append(StepRow(loop.experiment.controller, measurement, rms, loop.held, loop.runs))
    return ClosedLoopStudy(design, seed, tuple(loops), tuple(rows))
