"""The settings of a bench table: currents as a model takes them, what effects know of rows, which rows are repeats.

A table of very many readings as the means of short stretches of them, with the noise of a mean.

A stretch is rows of one run in the order of measuring, on one branch, over which no setting moves far. Of what a hidden
effect changes, a mean has all but the bend within its stretch: 1/24 of the square of the stretch over the range. The
noise of a mean follows from the halves of its stretch, however readings that follow each other are correlated: once the
model's own change is taken out, their difference has four times the variance of the mean. What lasts longer than a
stretch is left to the correlation of the means.

References
----------
N. R. Draper and H. Smith, Applied Regression Analysis (Wiley, 1998), section 2.1: lack of fit against pure error.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.numerics import BoolArray, FloatArray, IntArray, robust_deviation
from femfit.core.sweep_columns import current_columns, resistance_column
from femfit.effects.catalogue import all_effects
from femfit.effects.conditions import TEMPERATURES, Conditions, Nominal
from femfit.estimate.record import converter_step
from femfit.identify.constants import IN_ORDER, LEAST_REPEATS, MOST_DROPPED, MOST_ROWS, SAME_LINE, SAME_SETTING, SHORT
from femfit.identify.observations import Observations, circumstances, once_for_settings
from femfit.identify.words import finding, sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.impedance import impedances_by_column
from femfit.tables.header import parts_of
from femfit.tables.impedance import SERIES
from femfit.tables.measurement import STILL_CURRENT, BenchTable

AVERAGED_TO = 1000
"""Numerical: rows to about which a longer bench table is averaged."""


def currents_in(model: ActuatorModel, rows: pd.DataFrame) -> FloatArray:
    """Currents of the rows in A, in the shape that the model takes; NaN where a column is missing."""
    currents = rows.reindex(columns=current_columns(model.current_names)).to_numpy(dtype=np.float64)
    return currents if currents.shape[1] > 1 else currents[:, 0]


def leading_current(model: ActuatorModel, rows: pd.DataFrame) -> str:
    """Column of the current that was varied most, counted in widths of its range; the only one of one circuit."""
    names = current_columns(model.current_names)
    if len(names) == 1:
        return names[0]
    widths = np.ptp(model.validity.current_limits_A, axis=1)
    spread = rows[names].std(ddof=0).fillna(0.0) / np.maximum(widths, 1e-300)
    return names[int(np.argmax(spread))]


def with_currents(model: ActuatorModel, table: BenchTable) -> BenchTable:
    """The table with the current of each circuit, and with ``current_A`` as the leading one of several.

    Impedances that have ``current_A`` alone, of 0 A, were read without current in any circuit.

    Raises
    ------
    TableError
        If a current is missing, or it is not said to which circuit an impedance belongs.
    """
    names, rows, columns = current_columns(model.current_names), table.rows, table.given
    if len(names) > 1 and {"current_A", "frequency_Hz"} <= set(columns):
        currents = rows.reindex(columns=names)
        currents[currents.isna().all(axis=1) & (rows["current_A"] == 0.0)] = 0.0
        rows = rows.assign(**currents)
        columns = (*columns, *(name for name in names if name not in columns and currents[name].notna().any()))
    lacking = [name for name in names if name not in columns]
    if lacking and (model.circuits or len(names) > 1):
        raise TableError(sentence("refusals", "no_current", model, table, lacking, len(names) > 1))
    if len(names) == 1:
        return table
    circuits = model.without_effects.circuit_names
    inductances = list(impedances_by_column(np.eye(len(circuits), dtype=np.complex128), circuits))
    impedances = {*inductances, *map(resistance_column, inductances)}
    foreign = [name for name in table.channels if parts_of(name)[0] in SERIES and name not in impedances]
    if foreign:
        raise TableError(sentence("refusals", "foreign_impedance", model, table, circuits, foreign, inductances))
    return replace(table, rows=rows.assign(current_A=rows[leading_current(model, rows)]), given=columns)


def covariates_of(rows: pd.DataFrame, currents: Sequence[str]) -> pd.DataFrame:
    """Settings with runs and mounts numbered from 0, and both clocks."""
    run = pd.factorize(rows["run"])[0]
    mount = pd.factorize(rows["mount"].where(rows["mount"].notna(), rows["run"]))[0]
    place, order = pd.Series(run).groupby(run).cumcount().to_numpy(), rows["order"].to_numpy()
    order = np.where(np.isfinite(order), order, place)
    by_run = pd.Series(order).groupby(run)
    first, last = (by_run.agg(end).to_numpy() for end in ("min", "max"))
    within, elapsed = order - first[run], order - order.min()
    if (np.diff(first) <= 0.0).any():  # an order that starts anew with each run counts on from the run before
        elapsed = within + np.append(0.0, np.cumsum(last - first + 1.0)[:-1])[run]
    settings = ("distance_m", *dict.fromkeys(["current_A", *currents]), "branch", *TEMPERATURES)
    at_frequencies = "frequency_Hz" in rows and bool(rows["frequency_Hz"].notna().any())
    covariates = rows[[*settings, *(("frequency_Hz",) * at_frequencies)]].astype(np.float64).reset_index(drop=True)
    return covariates.assign(run=run, mount=mount, order=within, elapsed=elapsed).fillna({"branch": 0.0})


def conditions_of(covariates: pd.DataFrame, nominal: Nominal) -> Conditions:
    """What effects need to know of every row of the covariates; a temperature that was not recorded is NaN."""
    return Conditions(
        nominal=nominal,
        **circumstances(covariates, ("run", "distance_m")),
        time_s=covariates["order"].to_numpy(),
        elapsed=covariates["elapsed"].to_numpy(),
        recalled=_recalled(covariates, nominal),
        frequency_Hz=covariates["frequency_Hz"].to_numpy() if "frequency_Hz" in covariates else np.nan,
    )


def _recalled(covariates: pd.DataFrame, nominal: Nominal) -> Mapping[str, FloatArray]:
    """What the effects recall of the order of measuring; nothing where the branches contradict it."""
    in_order = covariates.sort_values(["run", "order"], kind="stable")
    current, run = in_order["current_A"].to_numpy(), in_order["run"].to_numpy()
    begins = np.append(True, run[1:] != run[:-1])
    path, still = current.copy(), STILL_CURRENT * np.ptp(current)
    for k in np.flatnonzero(~begins):
        if abs(current[k] - path[k - 1]) <= still:
            path[k] = path[k - 1]
    step, branch = np.where(begins, 0.0, np.diff(path, prepend=path[0])), in_order["branch"].to_numpy()
    same_place = np.append(False, np.diff(in_order["distance_m"].to_numpy()) == 0.0)
    # A branch that changes while the current stands still contradicts the order, but for a turning point read twice
    moving = same_place & (branch != 0.0) & ((step != 0.0) | np.append(False, branch[1:] != branch[:-1]))
    if not moving.any() or np.mean(np.sign(step[moving]) == branch[moving]) < IN_ORDER:
        return {}
    place = np.argsort(in_order.index.to_numpy())
    return {
        name: values[place]
        for effect in all_effects().values()
        if effect.memory is not None and effect.memory.recall is not None
        for name, values in effect.memory.recall(path, begins, nominal).items()
    }


@once_for_settings
def setting_cells(observations: Observations) -> IntArray:
    """A number for each setting: one level of distance, current and frequency, one branch.

    Readings of one channel with the same number are repeats.
    """
    keys: dict[str, Any] = {name: levels(observations.setting(name)) for name in observations.settings}
    keys["branch"] = observations.column("branch")
    return np.asarray(pd.DataFrame(keys).groupby(list(keys)).ngroup())


def levels(x: FloatArray) -> IntArray:
    """Numbers of the levels that a setting was brought to, each as wide as :data:`SAME_SETTING` of the setting's range.

    A stage or a supply that was meant to return to a value is recorded a little beside it; the misfit of a model hardly
    changes over that distance.
    """
    values, place = np.unique(x, return_inverse=True)
    near = np.array([SAME_SETTING * np.ptp(x)])
    return _groups_within(values[:, None], near, np.zeros(len(values), dtype=bool))[place]


def _groups_within(values: FloatArray, near: FloatArray, begins: BoolArray) -> IntArray:
    """Numbers of groups of rows (n, k) that stand together and are near to their first; some rows begin one anyhow."""
    begins, first = begins.copy(), 0
    for k, value in enumerate(values):
        begins[k] |= not (np.abs(value - values[first]) <= near).all()
        first = k if begins[k] else first
    return np.cumsum(begins) - begins[0]


def averaged(
    table: BenchTable, currents: Sequence[str], residuals: Callable[[BenchTable], Mapping[str, FloatArray]]
) -> BenchTable:
    """The table as means of stretches, where it has more rows than a comparison takes and stretches to be averaged.

    Parameters
    ----------
    currents : sequence of str
        Columns of the currents that were set.
    residuals : callable
        Readings of each channel that a model predicts, less what it predicts.
    """
    if len(table.rows) <= MOST_ROWS:
        return table
    number = stretches(table, currents)
    count = np.bincount(number)
    usual = float(np.median(count[number]))
    usable = count >= SHORT * usual
    if usual < 2.0 or usable.sum() > MOST_ROWS or np.mean(~usable) > MOST_DROPPED:  # the short ones are settings
        return table
    rows = table.rows.groupby(number).mean()[usable].reset_index(drop=True)
    residual = residuals(table)
    at_means, noise = residuals(replace(table, rows=rows)), {}
    for name, values in residual.items():  # the model's own bend within a stretch is no misfit; halves may be the same
        mean = pd.Series(values).groupby(number).mean()[usable].to_numpy()
        rows[name] = rows[name] - at_means[name] + mean
        sigma = noise_of_means(values, number, count * usable)
        step = converter_step(np.unique(table.rows[name]))
        if np.isfinite(sigma) and max(sigma, step) > 0.0:
            noise[name] = max(sigma, float(step / np.sqrt(12.0 * usual)))
    averaging = finding(
        "averaged",
        rows=len(table.rows),
        means=len(rows),
        readings=int(np.median(count[usable])),
        left_out=int(count[~usable].sum()),
        declared=[name for name in noise if name in table.declared_noise],
    )
    return replace(
        table,
        rows=rows,
        declared_noise={**table.declared_noise, **noise},
        noise_source="samples",
        findings=(*table.findings, averaging),
    )


def stretches(table: BenchTable, currents: Sequence[str]) -> IntArray:
    """Number of the stretch that each row belongs to, from 0; a row without a setting is one of its own.

    What could be longer is divided evenly. A temperature that is not read with each row is taken for the last one read.
    """
    rows, most = table.rows, -(-len(table.rows) // AVERAGED_TO)
    labels = rows[[name for name in ("run", "mount", "branch", "frequency_Hz") if name in rows]].fillna(0.0).to_numpy()
    settings = [name for name in ("distance_m", *currents, *TEMPERATURES) if name in rows]
    read = rows[[name for name in settings if rows[name].notna().any()]]
    values = read.fillna(read.filter(items=TEMPERATURES).ffill().bfill()).to_numpy()
    near = SAME_LINE * np.nanmax(values, axis=0) - SAME_LINE * np.nanmin(values, axis=0)
    number = _groups_within(values, near, np.append(True, np.any(labels[1:] != labels[:-1], axis=1)))
    count = np.bincount(number)
    place, parts = pd.Series(number).groupby(number).cumcount().to_numpy(), -(-count // most)
    piece = place * parts[number] // count[number]
    return np.cumsum(np.diff(number, prepend=0) + np.diff(piece, prepend=0) != 0)


def noise_of_means(residual: FloatArray, number: IntArray, count: IntArray) -> float:
    """Standard deviation of the mean of a stretch of usual length, from the differences of halves.

    NaN for fewer than twelve stretches. Those with a ``count`` of 0 are left out.
    """
    place, size = pd.Series(number).groupby(number).cumcount().to_numpy(), np.bincount(number)[number]
    halves = place < size // 2, place >= size - size // 2
    first, last = (pd.Series(residual).where(half).groupby(number).mean().to_numpy() for half in halves)
    shown = np.isfinite(last - first) & (count > 0)
    if np.count_nonzero(shown) < LEAST_REPEATS:
        return float("nan")
    length = count[shown] / np.median(np.repeat(count[shown], count[shown]))
    return 0.5 * float(robust_deviation((last - first)[shown] * np.sqrt(length)))
