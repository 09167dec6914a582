"""Measured readings beside what a model predicts for them: the one view that every step of a diagnosis has of the data.

All readings stand in one vector, channel after channel, each channel in the order of measuring. A bench table and a
time series differ only in how this view is built.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, wraps
from typing import Any, TypeVar, cast

import numpy as np
import pandas as pd

from femfit.core.numerics import BoolArray, FloatArray, IntArray
from femfit.core.results import Finding, kept
from femfit.core.sweep_columns import is_current
from femfit.effects.conditions import TEMPERATURES, Nominal
from femfit.effects.effect import AddedEffect
from femfit.model.actuator_model import ActuatorModel
from femfit.model.readings import Parameter

VOLTAGE_BALANCE = "voltage_balance"
"""How the channel of a circuit's voltage in a record begins; ``voltage_balance_V``, or ``voltage_balance_upper_V``."""

Prediction = Callable[[Sequence[AddedEffect], Sequence[Parameter]], FloatArray]
"""(further effects, parameters of theirs) -> readings, then their slopes by each parameter; (M, 1 + parameters)."""


@dataclass(frozen=True, eq=False)
class WithoutCache:
    """A record that is stored by its fields: what follows from them is large, and is worked out again on demand."""

    def __getstate__(self) -> dict[str, object]:
        """The fields alone."""
        return {each.name: getattr(self, each.name) for each in fields(self)}


@dataclass(frozen=True, eq=False)
class Observations(WithoutCache):
    """Readings of all channels as one vector of length M over a table of N settings."""

    channels: tuple[str, ...]
    # Index into ``channels`` and row of ``covariates`` of each reading; shape (M,)
    channel: IntArray
    row: IntArray
    value: FloatArray  # Readings as recorded, in the channel's unit; shape (M,)
    # N rows: ``run``, ``mount`` (numbered from 0), ``distance_m``, ``current_A``, ``branch``, ``coil_temperature_C``,
    # ``magnet_temperature_C``, ``order`` (within its run), ``elapsed`` (within the campaign); of several circuits each
    # ``current_NAME_A``, and ``current_A`` is that of the circuit whose current was varied most; of impedances
    # ``frequency_Hz``
    covariates: pd.DataFrame
    given: tuple[str, ...]  # Columns of the file that hold numbers
    prediction: Prediction
    distance_slope: FloatArray  # Change of each reading per metre of distance: what a re-mount changes; shape (M,)
    # Change of that per metre: what a re-mount changes where the force grows steeply; shape (M,)
    distance_curvature: FloatArray
    nominal: Nominal
    # Standard deviations as declared: of a channel's reading, as ``run.CHANNEL`` that by which all of its readings
    # differ from run to run, and of the ``distance_m`` to which stage and body come back
    declared_noise: Mapping[str, float]
    # Standard misfit of the model to its own source, below which nothing is said to be missing; shape (M,)
    tolerance: FloatArray
    # Change of each reading by one standard deviation of its row's distance, and of its current, as declared
    # shape (M, 2)
    setting_columns: FloatArray
    # What readings and predictions were multiplied by, of impedances to be given at one magnitude; shape (M,)
    weight: FloatArray
    findings: tuple[Finding, ...] = ()
    present: tuple[str, ...] = ()
    # What declares the noise: ``declared``, a sidecar; ``samples``, those within each window
    noise_source: str = "declared"
    # Of impedances: that magnitude in the channel's unit; see ``Weighing``
    magnitude: Mapping[str, float] = field(default_factory=dict)

    @property
    def of_settings(self) -> "Observations":
        """The first readings of the same settings, with which what follows from the settings alone is kept."""
        return cast("Observations", self.__dict__.get("_of_settings", self))

    @cached_property
    def base(self) -> FloatArray:
        """What the model predicts, shape (M,)."""
        return self.predict(())

    def predict(self, effects: Iterable[AddedEffect]) -> FloatArray:
        """What the model with further effects predicts, shape (M,)."""
        return self.predicted(tuple(effects), ())[:, 0]

    def predicted(self, effects: Sequence[AddedEffect], parameters: Sequence[Parameter]) -> FloatArray:
        """As :data:`Prediction`, each effect in the runs in which it acts; in others the slopes by its own are zero."""
        if all(added.runs is None for added in effects):
            return self.prediction(effects, parameters)
        result, run = np.zeros((len(self.value), 1 + len(parameters))), self.column("run").astype(int)
        within = [(0, self.runs) if added.runs is None else added.runs for added in effects]
        acting = [tuple(k for k, (first, last) in enumerate(within) if first <= r <= last) for r in range(self.runs)]
        for numbers in dict.fromkeys(acting):
            moving = [j for j, (k, _) in enumerate(parameters) if k in numbers]
            some = [(numbers.index(parameters[j][0]), parameters[j][1]) for j in moving]
            here = np.array([each == numbers for each in acting])[run]
            values = self.prediction([effects[k] for k in numbers], some)
            result[np.ix_(here, np.array([0, *(1 + j for j in moving)]))] = values[here]
        return result

    @property
    def clocked(self) -> bool:
        """Whether the order of measuring is known: a column says it, or the branches were read from it."""
        clocks = {"order", "time_s"} & set(self.given)
        return bool(clocks) or any(finding.code == "branch-assumed" for finding in self.findings)

    @property
    def currents(self) -> tuple[str, ...]:
        """The covariates of the current, or of each of several."""
        of_circuits = tuple(name for name in self.covariates.columns if is_current(name) and name != "current_A")
        return of_circuits or ("current_A",)

    @property
    def settings(self) -> tuple[str, ...]:
        """The covariates that somebody sets: distance and currents, and of impedances the frequency."""
        return ("distance_m", *self.currents, *(("frequency_Hz",) * self.of_impedances))

    @property
    def of_impedances(self) -> bool:
        """Whether the readings were taken at frequencies."""
        return "frequency_Hz" in self.covariates

    @property
    def in_motion(self) -> bool:
        """Whether the readings are those of windows of a record over time."""
        return "time_s" in self.covariates

    @property
    def leading_current(self) -> str:
        """The setting that ``current_A`` is: of several circuits, the current that was varied most."""
        leading = self.covariates["current_A"].to_numpy()
        same = (name for name in self.currents if np.array_equal(self.covariates[name].to_numpy(), leading))
        return next(same, "current_A")

    @property
    def residual(self) -> FloatArray:
        """Recorded minus predicted, shape (M,)."""
        return self.value - self.base

    def column(self, name: str) -> FloatArray:
        """A covariate at every reading, shape (M,)."""
        return self.covariates[name].to_numpy()[self.row]

    def setting(self, name: str) -> FloatArray:
        """A setting at every reading, on a scale along which equal steps count alike: a frequency's logarithm."""
        values = self.column(name)
        return np.log(np.maximum(values, 1e-3)) if name == "frequency_Hz" else values  # below a millihertz all is still

    def of(self, name: str) -> BoolArray:
        """Which readings belong to a channel."""
        return np.asarray(self.channel == self.channels.index(name))

    def mean_square(self, x: FloatArray) -> FloatArray:
        """Mean of squares of something at every reading, (M,), in each channel; shape (channels,)."""
        count = np.maximum(np.bincount(self.channel, minlength=len(self.channels)), 1)
        return np.asarray(np.bincount(self.channel, x**2, len(self.channels)) / count)

    def rms(self, x: FloatArray) -> dict[str, float]:
        """Its root by the channel's name."""
        return dict(zip(self.channels, np.sqrt(self.mean_square(x)).tolist(), strict=True))

    @property
    def runs(self) -> int:
        """Number of runs."""
        return int(self.covariates["run"].max()) + 1

    def select(self, keep: BoolArray) -> "Observations":
        """Those of the readings for which ``keep``, of shape (M,), is true; all settings stay."""
        state = self.__getstate__().items()
        some: dict[str, Any] = {name: values[keep] for name, values in state if isinstance(values, np.ndarray)}
        return replace(self, **some, prediction=lambda *asked: self.prediction(*asked)[keep])

    def with_values(self, value: FloatArray) -> "Observations":
        """The same settings with other readings, of shape (M,)."""
        result = replace(self, value=value)
        result.__dict__["base"] = self.base
        result.__dict__["_of_settings"] = self.of_settings
        return result


Result = TypeVar("Result")


def once_for_settings(function: Callable[[Observations], Result]) -> Callable[[Observations], Result]:
    """Work a function out once for all readings of the same settings."""

    @wraps(function)
    def once(observations: Observations) -> Result:
        return kept(observations.of_settings, function, lambda: function(observations))

    return once


@dataclass(frozen=True, eq=False)
class Stacking:
    """How values by row become those of readings: of each channel the rows that count, and factors on these."""

    rows: Mapping[str, IntArray]
    factor: Mapping[str, FloatArray]  # Of the channels that have one

    @property
    def channel(self) -> IntArray:
        """Number of the channel of each reading, shape (M,)."""
        return np.repeat(np.arange(len(self.rows)), [len(rows) for rows in self.rows.values()])

    def __call__(self, values: Mapping[str, FloatArray]) -> FloatArray:
        """Values by channel, each of shape (N,) or (k, N), as one array (M,) or (M, k), channel after channel."""
        return np.concatenate(
            [(values[name][..., rows] * self.factor.get(name, 1.0)).T for name, rows in self.rows.items()]
        )


def circumstances(covariates: pd.DataFrame, cycle: Sequence[str]) -> dict[str, Any]:
    """What conditions take of covariates: branches, temperatures, and the ends of the current over a cycle; (N,).

    A cycle is what the columns ``cycle`` are the same in.
    """
    current = covariates.groupby([*cycle])["current_A"]
    turns = tuple(current.transform(end).to_numpy() for end in ("min", "max"))
    return {name: covariates[name].to_numpy() for name in ("branch", *TEMPERATURES)} | {"current_turn_A": turns}


def model_tolerance(model: ActuatorModel) -> dict[str, float]:
    """Misfit of a model to the table that it was fitted to: root mean square per channel in which it is known.

    Readings lie between the points of that table as well as at them: what the model is expected to miss there counts
    where it is more.
    """
    misfit, sensor = model.misfit, model.sensor
    if misfit is None:
        return {}
    hall = None if sensor is None or misfit.hall_rms_T is None else misfit.hall_rms_T * abs(sensor.sensitivity_V_per_T)
    sizes = {"force_N": misfit.force_rms_N, "flux_linkage_Wb": misfit.flux_linkage_rms_Wb, "hall_V": hall}
    if (between := misfit.between) is not None:
        sizes["force_N"] = max(misfit.force_rms_N, between.force_rms_N)
        sizes["flux_linkage_Wb"] = max(misfit.flux_linkage_rms_Wb or 0.0, between.flux_linkage_rms_Wb or 0.0)
    return {name: size for name, size in sizes.items() if size is not None}
