"""Where the field of a current is taken from (a ratio, or lab runs).

Strengths of plays and lags are bounded below by zero: a loop runs in one direction, and an eddy current delays.
"""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from femfit.core.errors import FitError, TableError
from femfit.core.numerics import FloatArray
from femfit.fit.bounded_qp import BoundedQP
from femfit.integrate.field_of_current import FieldModel, FieldTerms, field_columns, precycled
from femfit.integrate.methods import IntegrationOptions, integrate_blocks, make_integrator
from femfit.integrate.uncertainty import SensingCoil
from femfit.tables.coil_record import open_coil_record

PATH_INTERVAL = 0.01
"""Seconds of a lab run that are averaged to one step of the current's path."""

ROW_STEPS = 10
"""Steps of the path that are averaged, field and columns alike, to one row of the fit."""

ROW_SIGMA = 1e-5
"""Believed error of a row, relative to the largest field."""

STRENGTH_SIGMA = 1e-2
"""Believed size of a play's or a lag's strength, relative to largest field over largest current: it decides between
columns that the runs do not tell apart."""

LEAST_SHARE = 0.01
"""Conventional: a current below zero by more than this part of the largest one is a second polarity, and no offset."""

FOLDS = 6
"""Stretches that are left out in turn to find the model's error."""

# Radii as fractions of the largest current: small ones for the loop's tips, large ones for its width.
_RADII = (1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 3 / 8, 1 / 2)
_LAG_TIMES_S = (3.0, 10.0, 30.0)


class LabRun(NamedTuple):
    """Time in s, current in A and field in T, shape (n,), of a magnet that was cycled to its largest current before."""

    time: FloatArray
    current: FloatArray
    field: FloatArray


def field_of_ratio(ratio: float, rms_T: float) -> FieldModel:
    """B = I / g with the ratio g in A/T, without hysteresis and eddy currents."""
    return FieldModel(FieldTerms(1.0, degree=1), np.array([0.5, 0.5]) / ratio, rms_T)


def identify_field(runs: Sequence[LabRun], terms: FieldTerms | None = None) -> FieldModel:
    """Fit the field to the current over lab runs; without ``terms`` by those for the runs' largest current."""
    sizes = [max(1, round(PATH_INTERVAL / float(np.median(np.diff(run.time))))) for run in runs]
    paths = [LabRun(*(_means(column, size) for column in run)) for run, size in zip(runs, sizes, strict=True)]
    top = max(float(run.current.max()) for run in paths)
    if terms is None:
        if top <= 0.0:
            raise FitError(f"A lab run must reach a current > 0 A; instead the largest is {top:g} A.")
        terms = FieldTerms(top, 7, tuple(top * fraction for fraction in _RADII), _LAG_TIMES_S)
    low = min(float(run.current.min()) for run in paths)
    if low < -LEAST_SHARE * top:
        raise FitError(
            f"A lab run must stay between 0 A and its largest current, {top:g} A, to which the magnet was cycled; "
            f"instead it goes down to {low:g} A. Record and integrate one polarity at a time."
        )
    columns = [field_columns(terms, precycled(terms), run.time, run.current)[1] for run in paths]
    matrix, field, current = (
        np.concatenate([_means(column, ROW_STEPS) for column in of_runs])
        for of_runs in (columns, [run.field for run in paths], [run.current for run in paths])
    )
    used = np.flatnonzero(np.any(matrix != 0.0, axis=0))
    lower = np.where(used <= terms.degree, -np.inf, 0.0)
    prior = np.eye(len(used))[np.isfinite(lower)]  # A row for each strength, of which little is believed without runs
    largest = float(np.abs(field).max())
    sigma = np.repeat([ROW_SIGMA * largest, STRENGTH_SIGMA * largest / top], [len(field), len(prior)])
    rows, target = np.concatenate([matrix[:, used], prior]), np.concatenate([field, np.zeros(len(prior))])
    names = [f"coefficient {k}" for k in used]
    coefficients = np.zeros(matrix.shape[1])
    coefficients[used] = BoundedQP(rows, target, sigma, lower, names=names).solve().x
    return FieldModel(terms, coefficients, _left_out_rms(rows, target, sigma, lower, current))


def _means(values: FloatArray, size: int) -> FloatArray:
    """Means of so many consecutive rows; the incomplete last ones are dropped."""
    rows = len(values) // size
    return np.asarray(values[: rows * size].reshape(rows, size, *values.shape[1:]).mean(axis=1))


def _left_out_rms(
    rows: FloatArray, target: FloatArray, sigma: FloatArray, lower: FloatArray, current: FloatArray
) -> float:
    """Rms error on each stretch of the runs when fitted to the others, at currents that the others reach."""
    squares = []
    for stretch in np.array_split(np.arange(len(current)), FOLDS):
        others, remaining = np.delete(current, stretch), np.delete(np.arange(len(rows)), stretch)
        reached = stretch[(current[stretch] <= others.max()) & (current[stretch] >= others.min())]
        x = BoundedQP(rows[remaining], target[remaining], sigma[remaining], lower).solve_unproven()
        squares.append(np.square(rows[reached] @ x - target[reached]))
    return float(np.sqrt(np.mean(np.concatenate(squares))))


def field_of_lab_record(lab: str | Path, coil: SensingCoil) -> FieldModel:
    """Identify the field of a magnet that was cycled before, from a record of coil, Hall probe and current."""
    record = open_coil_record(Path(lab))
    if not {"hall_T", "current_A"} <= set(record.columns):
        raise TableError(f"A lab record needs hall_T and current_A; {record.path} has {', '.join(record.columns)}.")
    blocks = record.blocks()
    first = next(blocks)
    integrator = make_integrator(IntegrationOptions("cs1-offset", coil), first)
    step = max(1, round(PATH_INTERVAL / integrator.sample_time))
    parts = [
        np.stack([_means(column, step) for column in (block.time, block.current, out.field) if column is not None])
        for block, out in integrate_blocks(integrator, itertools.chain([first], blocks))
    ]
    return identify_field([LabRun(*np.concatenate(parts, axis=1))])
