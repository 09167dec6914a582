"""Candidate laws ranked by their error: on rows that were not fitted, or as written on all rows where that is larger.

The folds are fixed: blocks of neighbouring distances between the outermost ones, all currents together, and single
inner currents, all distances together. A law's shape parameters are found again without the rows left out; its
coefficient functions are those that stage two chose. No row at the outermost distances is ever left out, and a
saturating armature's force is largest there: so the error as written counts where it is larger. The recommendation is
the cheapest law, in floating-point operations, whose error stays within 0.5 % of the weight; of the rms force, where
the moving part cannot hang within the sweep, its mass is unknown or the forces are far above it (a holding magnet's
are a thousand times its armature's weight).
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from femfit.core.errors import FemfitError, FitError
from femfit.core.numerics import BoolArray, FloatArray, ranked
from femfit.fit.constants import DISTANCE_BLOCKS, MAY_MISS, TARGET
from femfit.fit.law_columns import design_matrix
from femfit.fit.law_fit import LawFit, fit_law, law_magnetics, refit
from femfit.fit.misfit import as_written, misfit_to_rows
from femfit.fit.model_parts import validity_of
from femfit.fit.rows import FitRows, rms
from femfit.laws.law import ForceLaw
from femfit.model.actuator_model import ActuatorModel
from femfit.model.validity import Misfit


@dataclass(frozen=True, eq=False)
class Candidate:
    """A law and its error on rows left out."""

    fit: LawFit | None  # To all rows; None where the law could not be fitted
    law: ForceLaw
    misfit: Misfit | None  # The law's, as a model file would hold it, to all rows
    # Error on the rows left out, as a part of the weight (or of the rms force)
    held_out_rms: float
    held_out_max: float
    held_out_of_force: float  # Rms of error over force (its scale, where it passes through zero) on the rows left out
    rms: float  # Rms force error as written, on all rows, over the same scale
    parameters: int
    failure: str = ""  # Why it could not be fitted, or empty

    @property
    def error(self) -> float:
        """What the law is ranked by: the larger of its errors on rows left out and, as written, on all rows."""
        return max(self.held_out_rms, self.rms)


@dataclass(frozen=True, eq=False)
class Ranking:
    """Candidates, the smallest error first."""

    candidates: tuple[Candidate, ...]
    recommended: Candidate  # The cheapest within :data:`TARGET`, or else the best
    reached: bool  # Whether the recommended one is within the target
    of: str  # What the errors are a part of: ``weight`` or ``rms force``
    why_of: str  # Why it is the rms force, a clause; empty for the weight

    @property
    def failures(self) -> tuple[tuple[tuple[str, ...], str], ...]:
        """The laws that were not fitted, those of one reason together, and that reason."""
        return _grouped(self.candidates)

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data, best first; null in place of what a law that could not be fitted does not have."""
        return {
            "of": self.of,
            "why_of": self.why_of or None,
            "target": TARGET,
            "recommended": self.recommended.law.name,
            "reached": self.reached,
            "candidates": [
                {
                    "law": c.law.name,
                    "formula": c.law.formula,
                    "held_out_rms": c.held_out_rms if c.fit else None,
                    "held_out_max": c.held_out_max if c.fit else None,
                    "held_out_of_force": c.held_out_of_force if c.fit else None,
                    "rms": c.rms if c.fit else None,
                    "misfit": asdict(c.misfit) if c.misfit else None,
                    "operations": c.fit.operations if c.fit else None,
                    "parameters": c.parameters,
                    "functions": list(c.fit.functions) if c.fit else None,
                    "failure": c.failure or None,
                }
                for c in self.candidates
            ],
        }


def _grouped(candidates: Sequence[Candidate]) -> tuple[tuple[tuple[str, ...], str], ...]:
    """Names of the laws without a fit by their reason, in which ``Each`` stands for them where they are several."""
    groups: dict[str, list[Candidate]] = {}
    for candidate in candidates:
        if candidate.fit is None:
            groups.setdefault(candidate.failure.replace(f"Law {candidate.law.name}", "Each"), []).append(candidate)
    return tuple(
        (tuple(candidate.law.name for candidate in alike), why if len(alike) > 1 else alike[0].failure)
        for why, alike in groups.items()
    )


def rank_laws(laws: Sequence[ForceLaw], rows: FitRows) -> Ranking:
    """Fit every law, and rank them by :attr:`Candidate.error`."""
    folds = ranking_folds(rows)
    candidates = ranked([_candidate(law, rows, folds) for law in laws], lambda c: -c.error)
    fitted = [c for c in candidates if c.fit is not None]
    if not fitted:
        groups = _grouped(candidates)
        if len(candidates) > 1 and len(groups) == 1:
            raise FitError(f"No law could be fitted. {groups[0][1]}")
        raise FitError("No law could be fitted. " + " ".join(f"{', '.join(who)}: {why}" for who, why in groups[:3]))
    cost = {c.fit.operations: c for c in reversed(candidates) if c.fit and c.error <= TARGET}
    recommended = cost[min(cost)] if cost else fitted[0]
    return Ranking(tuple(candidates), recommended, bool(cost), rows.error_scale[1], _why_of(rows))


def _why_of(rows: FitRows) -> str:
    if rows.hanging_weight is not None:
        return ""
    if rows.weight is None:
        return "the mass is unknown"
    if rows.weight <= 0.0:
        return "the body does not hang by the force"
    low, high = float(np.min(rows.force)), float(np.max(rows.force))
    if low <= rows.weight <= high:
        return f"the forces, {rows.rms_force:.3g} N rms, are far above the weight, {rows.weight:.3g} N"
    return f"the weight, {rows.weight:.3g} N, is not among the sweep's forces, {low:.3g} to {high:.3g} N"


def ranking_folds(rows: FitRows) -> list[BoolArray]:
    """The rows that are left out together: blocks of inner distances, then inner currents where three remain."""
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
        magnetics = law_magnetics(fit, rows)
        candidate = ActuatorModel("candidate", magnetics, validity_of(magnetics, rows)[0])
        written = misfit_to_rows(as_written(candidate), rows)
    except (FemfitError, ValueError, ArithmeticError) as failure:  # one law, perhaps another package's, fails alone
        return _failed(law, str(failure))
    if not np.all(np.isfinite(errors)):
        return _failed(law, "its force on the rows left out is not finite.")
    fitted = rms(fit.joint.residual)
    if written.force_rms_N > MAY_MISS * max(fitted, 1e-9 * rows.rms_force):
        return _failed(
            law, f"as written it would miss the table by {written.force_rms_N:.3g} N, its fit by {fitted:.3g} N."
        )
    return Candidate(
        fit=fit,
        law=law,
        misfit=written,
        held_out_rms=rms(errors) / scale,
        held_out_max=float(np.max(np.abs(errors))) / scale,
        held_out_of_force=rms(errors / force_scale),
        rms=written.force_rms_N / scale,
        parameters=len(fit.terms) + len(fit.shape),
    )


def _failed(law: ForceLaw, reason: str) -> Candidate:
    return Candidate(None, law, None, np.inf, np.inf, np.inf, np.inf, 0, reason)


def _held_out(fit: LawFit, rows: FitRows, folds: Sequence[BoolArray]) -> tuple[FloatArray, FloatArray]:
    errors, scales = [], []
    for out in folds:
        shape, x = refit(fit.law, fit.shape, fit.functions, fit.limits, rows, ~out)
        test = rows.take(out)
        errors.append(design_matrix(fit.law, shape, fit.functions, test.distance, test.current) @ x - test.force)
        scales.append(rows.force_scale[out])
    return np.concatenate(errors), np.concatenate(scales)
