"""Runs of a loop, and again on the same noise as they were or with something taken away."""

from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from femfit.core.errors import DomainError, FilterError
from femfit.core.numerics import BoolArray
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.design import LoopDesign
from femfit.simulation.experiment import Experiment, run_experiments
from femfit.simulation.loop import LoopProgress, LoopResult, stage

CERTAIN = 30.0
"""Derived: growth times duration from which a deviation of one rounding, 1e-13 of the range, has grown to the range."""


@dataclass(frozen=True, eq=False)
class LoopRuns:
    """Everything that is needed to run a loop, and to run it again."""

    design: LoopDesign
    experiment: Experiment
    random: np.random.Generator  # As it was before the first run; it is copied
    runs: int
    steps: int  # Of each run, as far as it is to be followed
    path_steps: int  # That the reference is laid out for
    supported_steps: int
    plant: ActuatorModel | None  # What truly moves, where that is another model than the design's
    progress: LoopProgress | None = None

    def result(self, stage_name: str, random: np.random.Generator, **options: Any) -> LoopResult:
        """Run them, which the progress is told by a name; options are those of run_experiments."""
        (result,) = run_experiments(
            self.design,
            [self.experiment],
            random,
            runs=self.runs,
            steps=self.steps,
            supported_steps=self.supported_steps,
            plant=self.plant,
            path_steps=self.path_steps,
            show=stage(self.progress, stage_name),
            **options,
        )
        return result

    def held(self, trial: str) -> BoolArray | None:
        """Which runs are held this time, on the same noise; None where no such loop can be designed.

        Parameters
        ----------
        trial : str
            What is tried, as the progress says it.
        """
        try:
            if self.plant is None and self.growth_per_s * self.steps * self.design.model.sample_time_s > CERTAIN:
                # The linear loop tells already that this is no loop to advise, so that it need not be run
                return np.zeros(self.runs, dtype=np.bool_)
            return self.result(f"why runs are lost, {trial}", deepcopy(self.random), recorded=0).held
        except (DomainError, FilterError):
            return None

    @cached_property
    def growth_per_s(self) -> float:
        """Rate at which a deviation grows in the linear loop; below zero where it is stable."""
        return self.design.bench(self.experiment.observer).growth(self.design.controller(self.experiment.controller))

    @property
    def grows(self) -> bool:
        """Whether a deviation grows within the runs; no where nothing tells."""
        try:
            return self.growth_per_s * self.path_steps * self.design.model.sample_time_s > 1.0
        except (DomainError, FilterError):
            return False
