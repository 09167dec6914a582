"""A loop of which runs were lost, to be run again on the same noise as it was or with something taken away."""

from copy import deepcopy
from dataclasses import dataclass

import numpy as np

from femfit.core.errors import DomainError, FilterError
from femfit.core.numerics import BoolArray
from femfit.model.actuator_model import ActuatorModel
from femfit.simulation.design import LoopDesign
from femfit.simulation.experiment import Experiment, run_experiments
from femfit.simulation.loop import LoopProgress, stage

CERTAIN = 30.0
"""Derived: growth times duration from which a deviation of one rounding, 1e-13 of the range, has grown to the range."""


@dataclass(frozen=True, eq=False)
class LostLoop:
    """Everything that is needed to run a loop again."""

    design: LoopDesign
    experiment: Experiment
    random: np.random.Generator  # As it was before the first run; it is copied
    runs: int
    steps: int  # Of each run, as far as it is to be followed
    path_steps: int  # That the reference is laid out for
    supported_steps: int
    plant: ActuatorModel | None  # What truly moves, where that is another model than the design's
    progress: LoopProgress | None = None

    def held(self, trial: str) -> BoolArray | None:
        """Which runs are held this time; None where no such loop can be designed.

        Parameters
        ----------
        trial : str
            What is tried, as the progress says it.
        """
        try:
            if self.plant is None and self._grows():
                return np.zeros(self.runs, dtype=np.bool_)
            (result,) = run_experiments(
                self.design,
                [self.experiment],
                deepcopy(self.random),
                runs=self.runs,
                steps=self.steps,
                supported_steps=self.supported_steps,
                recorded=0,
                plant=self.plant,
                path_steps=self.path_steps,
                show=stage(self.progress, f"why runs are lost, {trial}"),
            )
        except (DomainError, FilterError):
            return None
        return result.held

    def _grows(self) -> bool:
        """Whether the linear loop tells already that this is no loop to advise, so that it need not be run."""
        growth = self.design.bench(self.experiment.observer).growth(self.design.controller(self.experiment.controller))
        return growth * self.steps * self.design.model.sample_time_s > CERTAIN
