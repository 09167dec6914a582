"""How far a model is from its table, that of the file as it is read back, and what the user is told of it; and laws.

Candidate laws ranked by their error: on rows that were not fitted, or as written on all rows where that is larger.

The folds are fixed: blocks of neighbouring distances between the outermost ones, all currents together, and single
inner currents, all distances together. A law's shape parameters are found again without the rows left out; its
coefficient functions are those that stage two chose. No row at the outermost distances is ever left out, and a
saturating armature's force is largest there: so the error as written counts where it is larger. The recommendation is
the cheapest law, in floating-point operations, whose error stays within 0.5 % of the weight; of the rms force, where
the moving part cannot hang within the sweep, its mass is unknown or the forces are far above it (a holding magnet's
are a thousand times its armature's weight).
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from femfit.core.errors import FemfitError, FitError
from femfit.core.numerics import BoolArray, FloatArray, ranked
from femfit.fit import constants
from femfit.fit.coenergy import CoenergyFit
from femfit.fit.law_columns import design_matrix
from femfit.fit.law_fit import LawFit, fit_law
from femfit.fit.model_parts import validity_of
from femfit.fit.rows import FitRows, rms, rms_share
from femfit.fit.words import note
from femfit.laws.law import ForceLaw
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_from_dict, model_to_dict
from femfit.model.magnetics import CoenergySpline, Magnetics
from femfit.model.validity import BetweenPoints, Misfit
from femfit.tables.sweep_table import SweepTable


def as_written(model: ActuatorModel) -> ActuatorModel:
    """The model as its file holds it, read back."""
    return model_from_dict(json.loads(json.dumps(model_to_dict(model))))


def misfit_to_rows(model: ActuatorModel, rows: FitRows) -> Misfit:
    """Model minus table in force, flux linkage and, with a sensor, the field at the Hall element.

    Beside those, of one circuit, the inductance. Of several, the rms misfit of all flux linkages together, and the
    largest of the circuits' shares, each of its own rms.
    """
    sensor, magnetics = model.sensor, model.magnetics
    error = magnetics.force(rows.distance, rows.circuit_currents) - rows.force
    stated: dict[str, Any] = {"flux_linkage_rms_Wb": None, "hall_rms_T": None}
    if rows.flux_linkage is not None:
        linked = magnetics.flux_linkage(rows.distance, rows.circuit_currents)
        missed = linked - rows.flux_linkage
        stated |= {"flux_linkage_rms_Wb": rms(missed), "flux_linkage_share": rms_share(missed, rows.flux_linkage)}
        if not rows.several:
            table, bent = (np.concatenate(rows.slopes(flux[:, 0])) for flux in (rows.flux_linkage, missed))
            if len(table):
                stated |= {"inductance_rms_H": rms(bent), "inductance_share": rms_share(bent, table)}
    if sensor is not None and rows.hall is not None:
        stated["hall_rms_T"] = rms(sensor.field.field(rows.distance, rows.circuit_currents) - rows.hall)
    return Misfit(
        force_rms_N=rms(error),
        force_max_N=float(np.max(np.abs(error))),
        force_rms_relative=rms(error / rows.force_scale),
        force_rms_of_weight=None if rows.hanging_weight is None else rms(error) / rows.hanging_weight,
        rows=len(error),
        against="sweep",
        force_share=rms_share(error, rows.force),
        **stated,
    )


def import_notes(table: SweepTable) -> tuple[str, ...]:
    """What an import warned of, and units that it assumed: a fit is wrong by the factor that they are."""
    findings = [finding for finding in table.manifest.get("findings") or () if isinstance(finding, dict)]
    return tuple(
        f"{finding.get('text', finding.get('sentence', ''))} {finding.get('remedy', '')}".strip()
        for finding in findings
        if finding.get("severity") == "warning" or finding.get("code") == "assumed-units"
    )


def misfit_notes(misfit: Misfit, magnetics: Magnetics) -> tuple[str, ...]:
    """Warnings where a model misses the table that it was fitted to, or is expected to between its points."""
    between, of_each, notes = misfit.between, misfit.force_rms_relative, []
    if between and (is_coarse(between) or of_each >= constants.COARSE["force"]):
        notes.append(note("coarse_sweep", between, is_coarse(between), of_each))
    shares = {"flux linkage": misfit.flux_linkage_share, "inductance": misfit.inductance_share}
    poor = {name: share for name, share in shares.items() if share is not None and share > constants.POOR_CIRCUIT}
    if poor:
        notes.append(note("circuit_misfit", poor, isinstance(magnetics, CoenergySpline)))
    return tuple(notes)


def is_coarse(between: BetweenPoints) -> bool:
    """Whether more is missed between the points of a sweep than a model's user should not know of."""
    shares = {"force": between.force_share, "inductance": between.inductance_share or 0.0}
    return any(share >= constants.COARSE[name] for name, share in shares.items())


def between_points(coenergy: CoenergyFit, rows: FitRows) -> BetweenPoints:
    """What a co-energy is expected to miss between its points, most beside what is allowed of force and inductance.

    Where the iron saturates a row is missed by as much as with its row left out: its neighbours on both sides hold it
    there as they do between two rows. At the least and at the largest distance they stand on one side, and a part of
    that counts. The place is that of the largest error when left out, in newtons or henries even where errors relative
    to each point's own force are poor: points there help between the points too, where points at the smallest forces do
    not.
    """
    missed = alone = coenergy.fitted
    if rows.saturates:
        alone = coenergy.left_out
        at_ends = np.isin(rows.distance, rows.distances[[0, -1]])
        missed = {
            name: np.maximum(errors, np.where(at_ends, constants.BETWEEN_AT_ENDS[name], 1.0) * coenergy.left_out[name])
            for name, errors in coenergy.fitted.items()
        }
    share = {name: rows.share(name, errors) for name, errors in missed.items() if name in constants.COARSE}
    worst = int(np.argmax(alone[max(share, key=lambda name: share[name] / constants.COARSE[name])]))
    distance, current = float(rows.distance[worst]), float(rows.current[worst])
    return BetweenPoints(
        force_rms_N=rms(missed["force"]),
        force_share=share["force"],
        distance_m=distance,
        current_A=current,
        finer_distance_m=tuple(middles(rows.distances, distance).tolist()),
        finer_current_A=tuple(middles(rows.currents, current).tolist()),
        flux_linkage_rms_Wb=rms(missed["flux linkage"]) if "flux linkage" in missed else None,
        inductance_share=share.get("inductance"),
    )


def middles(axis: FloatArray, place: float) -> FloatArray:
    """The middles of the intervals on both sides of a value of an axis."""
    k = int(np.searchsorted(axis, place))
    around = axis[max(k - 1, 0) : k + 2]
    return np.asarray(0.5 * (around[1:] + around[:-1]))


@dataclass(frozen=True, eq=False)
class Candidate:
    """A law and its error on rows left out."""

    data = (
        *("law=law.name", "formula=law.formula", "held_out_rms", "rms", "misfit", "operations=fit.operations"),
        *("parameters", "functions=fit.functions", "failure"),
    )

    law: ForceLaw
    fit: LawFit | None = None  # To all rows; None where the law could not be fitted
    misfit: Misfit | None = None  # The law's, as a model file would hold it, to all rows
    held_out_rms: float = np.inf  # Error on the rows left out, as a part of the weight (or of the rms force)
    rms: float = np.inf  # Rms force error as written, on all rows, over the same scale
    parameters: int = 0
    failure: str | None = None  # Why it could not be fitted

    @property
    def error(self) -> float:
        """What the law is ranked by: the larger of its errors on rows left out and, as written, on all rows."""
        return max(self.held_out_rms, self.rms)


@dataclass(frozen=True, eq=False)
class Ranking:
    """Candidates, the smallest error first."""

    data = "of", "target", "recommended=recommended.law.name", "reached", "candidates"
    target = constants.TARGET

    candidates: tuple[Candidate, ...]
    recommended: Candidate  # The cheapest within :data:`TARGET`, or else the best
    reached: bool  # Whether the recommended one is within the target
    of: str  # What the errors are a part of: ``weight`` or ``rms force``


def rank_laws(laws: Sequence[ForceLaw], rows: FitRows) -> Ranking:
    """Fit every law, and rank them by :attr:`Candidate.error`."""
    folds = ranking_folds(rows)
    candidates = ranked([_candidate(law, rows, folds) for law in laws], lambda c: -c.error)
    fitted = [c for c in candidates if c.fit is not None]
    if not fitted:
        reasons = dict.fromkeys(str(candidate.failure) for candidate in candidates)
        raise FitError(f"No law could be fitted. {' '.join([*reasons][:3])}")
    cost = {c.fit.operations: c for c in reversed(candidates) if c.fit and c.error <= constants.TARGET}
    recommended = cost[min(cost)] if cost else fitted[0]
    return Ranking(tuple(candidates), recommended, bool(cost), rows.error_scale[1])


def ranking_folds(rows: FitRows) -> list[BoolArray]:
    """The rows that are left out together: blocks of inner distances, then inner currents where three remain."""
    inner = rows.distances[1:-1]
    blocks = np.array_split(inner, min(constants.DISTANCE_BLOCKS, len(inner)))
    folds = [np.isin(rows.distance, block) for block in blocks]
    if len(rows.currents) > 3:
        folds.extend(rows.current == i for i in rows.currents[1:-1])
    return folds


def _candidate(law: ForceLaw, rows: FitRows, folds: Sequence[BoolArray]) -> Candidate:
    try:
        fit = fit_law(law, rows)
        left_out = []
        for out in folds:
            (shape, x), test = fit.refit(~out), rows.take(out)
            left_out.append(design_matrix(law, shape, fit.functions, test.distance, test.current) @ x - test.force)
        errors = np.concatenate(left_out)
        magnetics = fit.magnetics()
        candidate = ActuatorModel("candidate", magnetics, validity_of(magnetics, rows))
        written = misfit_to_rows(as_written(candidate), rows)
    except (FemfitError, ValueError, ArithmeticError) as failure:  # one law, perhaps another package's, fails alone
        return Candidate(law, failure=str(failure))
    if not np.all(np.isfinite(errors)):
        return Candidate(law, failure="its force on the rows left out is not finite.")
    return Candidate(
        fit=fit,
        law=law,
        misfit=written,
        held_out_rms=rms(errors) / rows.error_scale[0],
        rms=written.force_rms_N / rows.error_scale[0],
        parameters=len(fit.terms) + len(fit.shape),
    )
