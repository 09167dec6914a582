"""What many runs of one closed loop came to.

Recorded runs of a loop as a table: one row a sample, up to the sample at which a run was lost.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core import files as atomic
from femfit.core.files import LOOP, json_ready, path_of, require_outputs
from femfit.core.results import Printed
from femfit.core.sweep_columns import circuit_currents
from femfit.core.text import amount, counted
from femfit.estimate.noise import ConsistencyBand
from femfit.simulation.design import ControllerName, LoopDesign
from femfit.simulation.experiment import Experiment
from femfit.simulation.loop import LoopOutcome, LoopResult
from femfit.simulation.loop_text import TOO_CAUTIOUS, design_data, design_lines, verdict


def command_columns(design: LoopDesign) -> list[str]:
    """Names of the commands in a table: by the circuit's name where there are several."""
    circuits = design.model.circuits
    kinds = [("command", "A") if circuit.drive.kind == "current" else ("voltage", "V") for circuit in circuits]
    names = [f"_{circuit.name}" if len(circuits) > 1 else "" for circuit in circuits]
    return [f"{kind}{name}_{unit}" for (kind, unit), name in zip(kinds, names, strict=True)]


def reading_columns(design: LoopDesign) -> list[str]:
    """Names of the readings in a table: those of a record, from which any filter takes them."""
    readings = [sensor.reading for sensor in design.loop_sensors()]
    return [
        reading.column or f"{reading.name}_{reading.unit.replace('/', '_').replace('^', '')}" for reading in readings
    ]


def series_columns(design: LoopDesign) -> list[str]:
    """Names of all columns after the run and the time; what no sensor gives is named as the truth or an estimate."""
    return [
        *command_columns(design),
        *(f"true_{name}" for name in (*circuit_currents(design.model.circuit_names), "distance_m")),
        *reading_columns(design),
        "reference_m",
        "estimated_distance_m",
        "estimated_velocity_m_s",
        *(f"estimated_{name}" for name in circuit_currents(design.model.circuit_names)),
    ]


def write_series(design: LoopDesign, result: LoopResult, path: str | Path) -> None:
    """Write the recorded runs of a loop."""
    series, rows = result.series, []
    for run in range(series.distance_m.shape[1]):
        alive = np.flatnonzero(np.isfinite(series.distance_m[:, run]))
        columns = [
            series.commands,
            series.currents_A,
            series.distance_m[..., None],
            series.readings,
            series.reference_m[..., None],
            series.estimated_distance_m[..., None],
            series.estimated_velocity_m_s[..., None],
            series.estimated_currents_A,
        ]
        head = np.stack([np.full(len(alive), run + 1.0), result.time_s[alive]], axis=1)
        rows.append(np.concatenate([head, *(column[alive, run] for column in columns)], axis=1))
    names = ("run", "time_s", *series_columns(design))
    table = np.concatenate(rows) if rows else np.empty((0, len(names)))
    with atomic.replacing(path) as partial:
        formats = ["%d"] + ["%.9g"] * (len(names) - 1)
        np.savetxt(partial, table, delimiter=",", header=",".join(names), comments="", fmt=formats)


@dataclass(frozen=True)
class Spread:
    """Median and 95 % quantile of a number over the runs that were held; NaN if none was."""

    median: float
    upper: float


@dataclass(frozen=True, eq=False, repr=False)
class LoopSummary(Printed):
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
    advice : str
        Why runs were lost and what to do; empty where all were held.
    result : LoopResult
        Outcome of each run, and the series of those that were recorded.
    choice : str
        Why this controller was taken; empty where it was asked for.

    Examples
    --------
    >>> import femfit as ff
    >>> loop = ff.close_loop("model.json", controller="backstepping", targets_m=(0.022,), runs=2, seconds=0.1)
    >>> loop.held, loop.result.series.distance_m.shape
    (2, (200, 1))
    """

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
    advice: str
    result: LoopResult
    choice: str = ""

    @property
    def held(self) -> int:
        """Number of runs that were held."""
        return self.outcomes.get(LoopOutcome.HELD.name, 0)

    @property
    def expects_absent_errors(self) -> bool:
        """Whether innovations stay below their band in a plant that is the model, which has no process noise."""
        quality = self.normalised_innovation_squared
        same_plant = self.plant is None and self.experiment.force_scale == 1.0
        return same_plant and quality is not None and quality < self.innovation_band.lower

    @property
    def loop(self) -> tuple[ControllerName, str]:
        """Controller and observer."""
        return self.experiment.controller, self.experiment.observer

    def __str__(self) -> str:
        return "\n".join([*self._lines(), "", *design_lines(self.design, [self.loop])])

    def _lines(self) -> list[str]:
        seconds = self.steps * self.design.model.sample_time_s
        lines = [verdict(self.design, seconds, [(self.experiment, self.held, self.runs)], self.plant)]
        if self.choice:
            lines.append(f"  {self.choice}")
        for name, count in self.outcomes.items():
            if name != LoopOutcome.HELD.name:
                runs = counted(count, "run")
                lines.append(f"  {runs} lost: {LoopOutcome[name].sentence}")
        if self.last_loss_s is not None:
            lines.append(f"  lost between {self.first_loss_s:.4g} and {self.last_loss_s:.4g} s")
        if self.advice:
            lines.append(f"  {self.advice}")
        if self.held:
            for text, spread in (
                ("estimated - true distance", self.estimate_rms_m),
                ("true distance - reference", self.tracking_rms_m),
            ):
                median, upper = amount(spread.median, "m", 3), amount(spread.upper, "m", 3)
                lines.append(f"  rms of {text}: median {median}, 95 % below {upper}")
        if self.normalised_innovation_squared is not None:
            band = self.innovation_band
            lines.append(
                f"  squared errors of the filter's predictions are {self.normalised_innovation_squared:.3f} of what it "
                f"expects (a filter that knows its errors: {band.lower:.3f} to {band.upper:.3f}, 95 %)"
            )
            if self.expects_absent_errors:
                lines.append(f"  less than expected, because {TOO_CAUTIOUS}")
        return lines

    def data(self) -> dict[str, Any]:
        """The numbers without the series, ready for JSON."""
        names = (
            "plant",
            "runs",
            "steps",
            "first_loss_s",
            "last_loss_s",
            "normalised_innovation_squared",
            "advice",
            "choice",
        )
        return {
            "model": self.design.model.name,
            "experiment": json_ready(asdict(self.experiment)),
            "outcomes": dict(self.outcomes),
            **{name: json_ready(getattr(self, name)) for name in names},
            **{
                name: json_ready(asdict(getattr(self, name)))
                for name in ("estimate_rms_m", "tracking_rms_m", "innovation_band")
            },
            "design": design_data(self.design, [self.loop]),
        }

    def write_csv(self, path: str | Path) -> None:
        """Write the recorded runs, one row a sample, up to the sample at which a run was lost."""
        require_outputs([], (path_of(path, "The table of the runs"), LOOP))
        write_series(self.design, self.result, path)
