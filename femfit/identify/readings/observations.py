"""Measured readings beside what a model predicts for them: the one view that every step of a diagnosis has of the data.

All readings stand in one vector, channel after channel, each channel in the order of measuring. A bench table and a
time series differ only in how this view is built.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd

from femfit.core.arrays import BoolArray, FloatArray, IntArray
from femfit.core.errors import TableError
from femfit.core.finding import Finding
from femfit.effects.conditions import Nominal
from femfit.effects.effect import AddedEffect
from femfit.identify.readings.bench_conditions import conditions_of
from femfit.identify.readings.reach import nothing_in_reach, within_reach
from femfit.model.actuator_model import ActuatorModel
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of
from femfit.tables.measurement import BenchTable

Predict = Callable[[Iterable[AddedEffect]], FloatArray]


@dataclass(frozen=True, eq=False)
class Observations:
    """Readings of all channels as one vector of length M over a table of N settings.

    Parameters
    ----------
    channels : tuple of str
        Measured channels that the model can predict.
    channel, row : array of int, shape (M,)
        Index into ``channels`` and row of ``covariates`` of each reading.
    value : array, shape (M,)
        As recorded, in the channel's unit.
    covariates : DataFrame
        N rows: ``run``, ``mount`` (numbered from 0), ``distance_m``, ``current_A``, ``branch``, ``coil_temperature_C``,
        ``magnet_temperature_C``, ``order`` (within its run), ``elapsed`` (within the campaign).
    given : tuple of str
        Columns of the file that hold numbers.
    predict : callable
        Further effects -> what the model with them predicts, shape (M,).
    distance_slope : array, shape (M,)
        Change of each reading per metre of distance: what a re-mount changes.
    distance_curvature : array, shape (M,)
        Change of that per metre: what a re-mount changes where the force grows steeply.
    tolerance : array, shape (M,)
        Standard misfit of the model to its own source, below which nothing is said to be missing.
    findings : tuple of str
        What was left out, one plain sentence each.
    present : tuple of str
        Effects that the model has already.
    noise_source : str
        What declares the noise: ``declared``, a sidecar; ``samples``, those within each window.
    """

    channels: tuple[str, ...]
    channel: IntArray
    row: IntArray
    value: FloatArray
    covariates: pd.DataFrame
    given: tuple[str, ...]
    predict: Predict
    distance_slope: FloatArray
    distance_curvature: FloatArray
    nominal: Nominal
    declared_noise: Mapping[str, float]
    tolerance: FloatArray
    findings: tuple[Finding, ...] = ()
    present: tuple[str, ...] = ()
    noise_source: str = "declared"

    @cached_property
    def base(self) -> FloatArray:
        """What the model predicts, shape (M,)."""
        return self.predict(())

    @property
    def residual(self) -> FloatArray:
        """Recorded minus predicted, shape (M,)."""
        return self.value - self.base

    def column(self, name: str) -> FloatArray:
        """A covariate at every reading, shape (M,)."""
        return self.covariates[name].to_numpy()[self.row]

    def of(self, name: str) -> BoolArray:
        """Which readings belong to a channel."""
        return np.asarray(self.channel == self.channels.index(name))

    def select(self, keep: BoolArray) -> "Observations":
        """Some of the readings, with all settings kept.

        Parameters
        ----------
        keep : array of bool, shape (M,)
            Readings that stay.
        """
        predict = self.predict
        return replace(
            self,
            channel=self.channel[keep],
            row=self.row[keep],
            value=self.value[keep],
            distance_slope=self.distance_slope[keep],
            distance_curvature=self.distance_curvature[keep],
            tolerance=self.tolerance[keep],
            predict=lambda effects: predict(effects)[keep],
        )

    def with_values(self, value: FloatArray) -> "Observations":
        """The same settings with other readings.

        Parameters
        ----------
        value : array, shape (M,)
            In place of ``value``.
        """
        result = replace(self, value=value)
        result.__dict__["base"] = self.base
        return result


def bench_observations(model: ActuatorModel, table: BenchTable) -> Observations:
    """Place a bench table beside a model.

    Returns
    -------
    Observations
        Of the rows within the model's reach and the channels that it predicts.

    Raises
    ------
    TableError
        If no reading can be compared.
    """
    rows, findings = table.rows, []
    d, i = rows["distance_m"].to_numpy(), rows["current_A"].to_numpy()
    known = np.isfinite(d) & np.isfinite(i)
    reach = known & within_reach(model, d, i)
    if not known.all():
        text = f"{_rows(~known, 'without distance or current')} left out."
        findings.append(Finding("unplaced", "info", text, size=float((~known).sum())))
    if (known & ~reach).any():
        outside = _rows(known & ~reach, "outside of the model's validity domain")
        remedy = "Sweep and fit a wider range to use them."
        findings.append(
            Finding("outside-domain", "info", f"{outside} left out.", remedy, float((known & ~reach).sum()))
        )
    if not reach.any():
        raise TableError(nothing_in_reach(model, table))
    covariates = _covariates(rows[reach].reset_index(drop=True))
    nominal = nominal_of(model)
    at = conditions_of(covariates, nominal)
    d, i = covariates["distance_m"].to_numpy(), covariates["current_A"].to_numpy()
    own = model.effects
    reading = predict_readings(model, d, i, at)
    measured = rows[reach]
    channels = tuple(name for name in table.channels if name in reading and measured[name].notna().any())
    pieces = [np.flatnonzero(np.isfinite(measured[name].to_numpy())) for name in channels]
    if not any(len(piece) for piece in pieces):
        raise TableError(
            f"{table.source} must have at least one reading of a channel that the model predicts "
            f"({', '.join(reading)}) within its box; none was found. Check the columns, units and the model's range."
        )
    row = np.concatenate(pieces)
    channel = np.repeat(np.arange(len(channels)), [len(piece) for piece in pieces])
    value = np.concatenate([measured[name].to_numpy()[piece] for name, piece in zip(channels, pieces, strict=True)])

    def stacked(values: Mapping[str, FloatArray]) -> FloatArray:
        return np.concatenate([values[name][piece] for name, piece in zip(channels, pieces, strict=True)])

    def predict(effects: Iterable[AddedEffect]) -> FloatArray:
        return stacked(predict_readings(model, d, i, at, (*own, *effects)))

    step = 1e-3 * (nominal.distance_max_m - nominal.distance_min_m)
    ahead, behind = (predict_readings(model, d + s, i, at) for s in (step, -step))
    slope = (stacked(ahead) - stacked(behind)) / (2.0 * step)
    curvature = (stacked(ahead) - 2.0 * stacked(reading) + stacked(behind)) / step**2
    tolerance = model_tolerance(model)
    return Observations(
        channels=channels,
        channel=channel,
        row=row,
        value=value,
        covariates=covariates,
        given=table.given,
        predict=predict,
        distance_slope=slope,
        distance_curvature=curvature,
        nominal=nominal,
        declared_noise=table.declared_noise,
        tolerance=np.array([tolerance.get(name, 0.0) for name in channels])[channel],
        findings=(*table.findings, *findings),
        present=tuple(added.effect.name for added in own),
    )


def _rows(which: BoolArray, words: str) -> str:
    count = int(which.sum())
    return f"{count} row{'s' if count > 1 else ''} {words} {'were' if count > 1 else 'was'}"


def _covariates(rows: pd.DataFrame) -> pd.DataFrame:
    """Settings with runs and mounts numbered from 0 and both clocks."""
    run = pd.factorize(rows["run"])[0]
    mount_label = rows["mount"].where(rows["mount"].notna(), rows["run"])
    mount = pd.factorize(mount_label)[0]
    place = pd.Series(run).groupby(run).cumcount().to_numpy(dtype=np.float64)
    order = rows["order"].to_numpy()
    order = np.where(np.isfinite(order), order, place)
    first = pd.Series(order).groupby(run).transform("min").to_numpy()
    within = order - first
    longest = pd.Series(within).groupby(run).max().to_numpy()
    # An order that starts anew with each run counts on from the run before
    restarts = len(np.unique(run)) > 1 and bool(np.any(np.diff(pd.Series(order).groupby(run).min().to_numpy()) <= 0.0))
    start = np.concatenate([[0.0], np.cumsum(longest + 1.0)[:-1]])
    elapsed = start[run] + within if restarts else order - order.min()
    names = ("distance_m", "current_A", "branch", "coil_temperature_C", "magnet_temperature_C")
    return pd.DataFrame(
        {
            "run": run,
            "mount": mount,
            **{name: rows[name].to_numpy(dtype=np.float64) for name in names},
            "order": within,
            "elapsed": elapsed,
        }
    ).fillna({"branch": 0.0})


def model_tolerance(model: ActuatorModel) -> dict[str, float]:
    """Misfit of a model to the sweep that it was fitted to.

    Returns
    -------
    dict of str to float
        Root mean square per channel of a bench that is known.
    """
    misfit, sensor = model.misfit, model.sensor
    if misfit is None:
        return {}
    result = {"force_N": misfit.force_rms_N}
    if misfit.flux_linkage_rms_Wb is not None:
        result["flux_linkage_Wb"] = misfit.flux_linkage_rms_Wb
    if misfit.hall_rms_T is not None and sensor is not None:
        result["hall_V"] = misfit.hall_rms_T * abs(sensor.sensitivity_V_per_T)
    return result
