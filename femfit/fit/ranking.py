"""Candidate laws ranked on rows that were not fitted.

The folds are fixed: blocks of neighbouring distances between the outermost ones, all currents together, and single
inner currents, all distances together. A law's shape parameters are found again without the rows left out; its
coefficient functions are those that stage two chose. The recommendation is the cheapest law, in floating-point
operations, whose held-out error stays within 0.5 % of the weight; of the rms force, where the moving part cannot hang
within the sweep, its mass is unknown or the forces are far above it (a holding magnet's are a thousand times its
armature's weight).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.errors import FitError
from femfit.fit.bounded_qp import active_set_least_squares
from femfit.fit.law_columns import design_matrix
from femfit.fit.law_fit import LawFit, fit_law, fit_shape, law_sigma
from femfit.fit.rows import FitRows
from femfit.laws.law import ForceLaw

TARGET = 5e-3
"""Held-out rms error, as a part of the weight (or of the rms force), that is good enough."""

DISTANCE_BLOCKS = 8


@dataclass(frozen=True, eq=False)
class Candidate:
    """A law and its error on rows left out.

    Parameters
    ----------
    fit : LawFit or None
        To all rows; None where the law could not be fitted.
    held_out_rms, held_out_max : float
        Error on the rows left out, as a part of the weight (or of the rms force).
    held_out_of_force : float
        Rms of error over force (its scale, where it passes through zero) on the rows left out.
    rms : float
        Error of the joint fit to all rows, as a part of the same.
    failure : str
        Why it could not be fitted, or empty.
    """

    fit: LawFit | None
    law: ForceLaw
    held_out_rms: float
    held_out_max: float
    held_out_of_force: float
    rms: float
    parameters: int
    failure: str = ""


@dataclass(frozen=True, eq=False)
class Ranking:
    """Candidates, best on held-out rows first.

    Parameters
    ----------
    recommended : Candidate
        The cheapest within :data:`TARGET`, or else the best.
    reached : bool
        Whether the recommended one is within the target.
    of : str
        What the errors are a part of: ``weight`` or ``rms force``.
    why_of : str
        Why it is the rms force, a clause; empty for the weight.
    """

    candidates: tuple[Candidate, ...]
    recommended: Candidate
    reached: bool
    of: str
    why_of: str


def rank_laws(laws: Sequence[ForceLaw], rows: FitRows) -> Ranking:
    """Fit every law, and rank them by their error on held-out rows.

    Raises
    ------
    FitError
        If no law could be fitted.
    """
    folds = ranking_folds(rows)
    candidates = sorted((_candidate(law, rows, folds) for law in laws), key=lambda c: c.held_out_rms)
    fitted = [c for c in candidates if c.fit is not None]
    if not fitted:
        if len(candidates) > 1 and len({c.failure for c in candidates}) == 1:
            raise FitError(f"No law could be fitted. {candidates[0].failure}")
        raise FitError("No law could be fitted. " + " ".join(f"{c.law.name}: {c.failure}" for c in candidates[:3]))
    cost = {c.fit.operations: c for c in reversed(candidates) if c.fit and c.held_out_rms <= TARGET}
    recommended = cost[min(cost)] if cost else fitted[0]
    return Ranking(tuple(candidates), recommended, bool(cost), rows.error_scale[1], _why_of(rows))


def _why_of(rows: FitRows) -> str:
    if rows.hanging_weight is not None:
        return ""
    if rows.weight is None:
        return "the mass is unknown"
    low, high = float(np.min(rows.force)), float(np.max(rows.force))
    if low <= rows.weight <= high:
        return f"the forces, {rows.rms_force:.3g} N rms, are far above the weight, {rows.weight:.3g} N"
    return f"the weight, {rows.weight:.3g} N, is not among the sweep's forces, {low:.3g} to {high:.3g} N"


def ranking_folds(rows: FitRows) -> list[BoolArray]:
    """The rows that are left out together.

    Returns
    -------
    list of array of bool
        Blocks of neighbouring inner distances, then inner currents where at least three remain.
    """
    inner = rows.distances[1:-1]
    blocks = np.array_split(inner, min(DISTANCE_BLOCKS, len(inner)))
    folds = [np.isin(rows.distance, block) for block in blocks]
    if len(rows.currents) > 3:
        folds.extend(rows.current == i for i in rows.currents[1:-1])
    return folds


def _candidate(law: ForceLaw, rows: FitRows, folds: Sequence[BoolArray]) -> Candidate:
    scale, _ = rows.error_scale
    try:
        fit = fit_law(law, rows)
        errors, force_scale = _held_out(fit, rows, folds)
    except (FitError, ValueError, ArithmeticError) as failure:  # one law, perhaps another package's, fails alone
        return _failed(law, str(failure))
    if not np.all(np.isfinite(errors)):
        return _failed(law, "its force on the rows left out is not finite.")
    return Candidate(
        fit=fit,
        law=law,
        held_out_rms=float(np.sqrt(np.mean(errors**2))) / scale,
        held_out_max=float(np.max(np.abs(errors))) / scale,
        held_out_of_force=float(np.sqrt(np.mean((errors / force_scale) ** 2))),
        rms=float(np.sqrt(np.mean(fit.joint.residual**2))) / scale,
        parameters=len(fit.terms) + len(fit.shape),
    )


def _failed(law: ForceLaw, reason: str) -> Candidate:
    return Candidate(None, law, np.inf, np.inf, np.inf, np.inf, 0, reason)


def _held_out(fit: LawFit, rows: FitRows, folds: Sequence[BoolArray]) -> tuple[FloatArray, FloatArray]:
    sigma, limits = law_sigma(rows), fit.limits
    errors, scales = [], []
    for out in folds:
        part, test = rows.take(~out), rows.take(out)
        shape = fit_shape(fit.law, part, sigma[~out], fit.shape)
        matrix = design_matrix(fit.law, shape, fit.functions, part.distance, part.current)
        x = active_set_least_squares(matrix, part.force, sigma[~out], limits.lower, limits.upper, limits.inequalities)
        errors.append(design_matrix(fit.law, shape, fit.functions, test.distance, test.current) @ x - test.force)
        scales.append(rows.force_scale[out])
    return np.concatenate(errors), np.concatenate(scales)
