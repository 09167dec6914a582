"""From a sweep table to an actuator model: what ``femfit fit`` and ``femfit run`` call."""

import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

import numpy as np

from femfit.core.constants import GRAVITY
from femfit.core.errors import FitError
from femfit.fit.bounded_qp import solve_bounded_qp
from femfit.fit.coenergy import CoenergyFit, fit_coenergy
from femfit.fit.hall import HallFit, fit_hall
from femfit.fit.law_fit import LawFit, fit_law
from femfit.fit.linearity import LinearityTest, linearity_test
from femfit.fit.misfit import misfit_between, misfit_to_rows
from femfit.fit.model_parts import model_parts
from femfit.fit.named_bounds import bounds_by_name
from femfit.fit.notes import coarse_note, import_notes
from femfit.fit.ranking import Ranking, rank_laws
from femfit.fit.result_data import coenergy_data, hall_data, law_data, linearity_data, ranking_data
from femfit.fit.rows import FitRows, rows_of_table
from femfit.laws.catalogue import all_laws, law_by_name
from femfit.model.actuator_kind import ActuatorKind
from femfit.model.actuator_model import ActuatorModel, Misfit, ValidityBox
from femfit.model.magnetics import Coefficient, LawMagnetics, Magnetics
from femfit.tables.sweep_table import SweepTable

COENERGY = "coenergy"
ALL = "all"


@dataclass(frozen=True)
class FitOptions:
    """What to fit and how.

    Parameters
    ----------
    model : str
        ``coenergy``, a law's name, or ``all``: every law is ranked and the recommended one becomes the model.
    bounds : str
        ``law``, ``none``, ``paper`` or ``paper-coefficients``; see :mod:`femfit.fit.named_bounds`. For
        one law only, as the two next.
    coefficient_bounds : mapping of str to (float, float)
        Bounds of single columns' coefficients, over those of ``bounds``.
    functions : tuple of str or None
        Coefficient function of each column, without choosing by held-out error.
    stages : str
        ``two`` puts the two-stage coefficients into the model, ``joint`` those of the one-stage fit.
    constraints : tuple of str or None
        Shape constraints of the co-energy; None: those that the raw data obey.
    inductance_H : float or None
        Inductance at the largest distance, for a table without flux linkage.
    actuator : mapping or None
        Replaces values of the manifest's ``actuator`` entry.
    """

    model: str = COENERGY
    bounds: str = "law"
    coefficient_bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    functions: tuple[str, ...] | None = None
    stages: str = "two"
    constraints: tuple[str, ...] | None = None
    inductance_H: float | None = None
    actuator: Mapping[str, Any] | None = None
    mass_kg: float | None = None
    resistance_ohm: float | None = None

    def __post_init__(self) -> None:
        if self.stages not in {"two", "joint"}:
            raise FitError(f"Stages must be 'two' or 'joint'; instead received {self.stages!r}.")
        if self.model not in {COENERGY, ALL, *all_laws()}:
            raise FitError(
                f"The model must be {COENERGY}, {ALL} or a law ({', '.join(all_laws())}); instead received "
                f"{self.model!r}."
            )
        for_one_law = [name for name in ("coefficient_bounds", "functions") if getattr(self, name)]
        if self.bounds != "law":
            for_one_law.append("bounds")
        if for_one_law and self.model in {COENERGY, ALL}:
            raise FitError(
                f"{' and '.join(for_one_law)} can be given for one law only; instead received model {self.model!r}. "
                "Leave out the option or name a law."
            )
        for name in ("mass_kg", "resistance_ohm", "inductance_H"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise FitError(f"{name} must be > 0; instead received {value:g}.")


@dataclass(frozen=True, eq=False)
class FitResult:
    """A model and how it came about.

    Parameters
    ----------
    model : ActuatorModel
        To write with :func:`femfit.model.json_file.write_model`.
    coenergy : CoenergyFit or None
        The reference; the model itself where a co-energy was asked for; None where the table is too small for one.
    law : LawFit or None
        The law, where one was asked for or recommended.
    ranking : Ranking or None
        Where all laws were asked for.
    hall : HallFit or None
        Where the table has the field at a Hall element.
    linearity : LinearityTest or None
        Table 2 of the paper, on these data.
    misfits : tuple of Misfit
        Of the model, against the sweep first, then of a law against the co-energy reference.
    notes : tuple of str
        What the model lacks, and how to give it.
    of_data : tuple of str
        What the table's import warned of.
    """

    model: ActuatorModel
    coenergy: CoenergyFit | None
    law: LawFit | None
    ranking: Ranking | None
    hall: HallFit | None
    linearity: LinearityTest | None
    misfits: tuple[Misfit, ...]
    rows: FitRows
    notes: tuple[str, ...]
    data: Mapping[str, Any]
    of_data: tuple[str, ...] = ()


def fit_model(table: SweepTable, options: FitOptions | None = None) -> FitResult:
    """Fit a model to a sweep table.

    Parameters
    ----------
    table : SweepTable
        Of the sweep or an import.
    options : FitOptions or None
        None for a co-energy with everything by default.

    Raises
    ------
    TableError
        If the table cannot be fitted at all.
    FitError
        If the fit has no accepted optimum; :class:`femfit.core.errors.InfeasibleFitError` if the bounds exclude all.
    """
    options = options or FitOptions()
    entry = actuator_entry(table, options)
    rows = rows_of_table(table, entry.get("mass_kg"), GRAVITY)
    law, ranking = _law(rows, options)
    coenergy = _coenergy(rows, options, needed=law is None)
    hall = None if rows.hall is None or len(rows.currents) < 2 else fit_hall(rows, rows.hall)
    linearity = linearity_test(rows)
    magnetics: Magnetics
    misfits = []
    if law is not None:
        magnetics = law_magnetics(law, rows, options)
        if coenergy is not None:
            misfits.append(misfit_between(magnetics, coenergy.magnetics, rows))
    elif coenergy is not None:
        magnetics = coenergy.magnetics
    misfits.insert(0, misfit_to_rows(magnetics, rows, hall.rms_T if hall else None))
    parts = model_parts(entry, rows, hall, options.inductance_H is not None)
    notes = (*parts.notes, *coarse_note(coenergy, rows))
    of_data = import_notes(table)
    data = {
        "model": options.model,
        "stages": options.stages,
        "bounds": options.bounds,
        "rows": len(rows.force),
        "misfits": [vars(m) for m in misfits],
        "coenergy": coenergy_data(coenergy) if coenergy else None,
        "law": law_data(law, rows) if law else None,
        "ranking": ranking_data(ranking) if ranking else None,
        "hall": hall_data(hall) if hall else None,
        "linearity": linearity_data(linearity) if linearity else None,
        "notes": [*of_data, *notes],
    }
    model = ActuatorModel(
        name=str(entry.get("name") or table.manifest.get("name") or "actuator"),
        magnetics=magnetics,
        validity=ValidityBox(
            float(rows.distances[0]), float(rows.distances[-1]), float(rows.currents[0]), float(rows.currents[-1])
        ),
        circuit=parts.circuit,
        motion=parts.motion,
        sensor=parts.sensor,
        misfit=misfits[0],
        sample_time_s=float(entry.get("sample_time_s") or 0.5e-3),
        reference_distances_m=tuple(float(d) for d in entry.get("reference_distances_m") or ()),
        covariance=law.interval.block_covariance if law else None,
        kind=ActuatorKind(**entry["kind"]) if entry.get("kind") else None,
        provenance={
            "fit": data,
            "sweep": {key: value for key, value in table.manifest.items() if key != "actuator"},
            "versions": _versions(),
        },
    )
    return FitResult(model, coenergy, law, ranking, hall, linearity, tuple(misfits), rows, notes, data, of_data)


def _law(rows: FitRows, options: FitOptions) -> tuple[LawFit | None, Ranking | None]:
    if options.model == COENERGY:
        return None, None
    if options.model == ALL:
        ranking = rank_laws(tuple(all_laws().values()), rows)
        return ranking.recommended.fit, ranking
    law = law_by_name(options.model)
    bounds = bounds_by_name(options.bounds, law, rows, options.coefficient_bounds)
    return fit_law(law, rows, bounds, options.functions), None


def _coenergy(rows: FitRows, options: FitOptions, needed: bool) -> CoenergyFit | None:
    """The co-energy; None for a table too small for one, where only a law's reference was wanted."""
    try:
        return fit_coenergy(rows, options.constraints, options.inductance_H or 0.0)
    except FitError:
        if needed:
            raise
        return None


def actuator_entry(table: SweepTable, options: FitOptions) -> dict[str, Any]:
    """The manifest's actuator entry with the options' replacements.

    Returns
    -------
    dict
        Keys as in :class:`femfit.tables.sweep_table.SweepTable`.
    """
    entry = dict(table.manifest.get("actuator") or {})
    entry.update(options.actuator or {})
    if options.mass_kg is not None:
        entry["mass_kg"] = options.mass_kg
    if options.resistance_ohm is not None:
        entry["resistance_ohm"] = options.resistance_ohm
    return entry


def law_magnetics(law: LawFit, rows: FitRows, options: FitOptions) -> LawMagnetics:
    """The fitted law with the constant flux linkage and inductance that reciprocity leaves open.

    Parameters
    ----------
    rows : FitRows
        Whose flux linkage gives the constants.
    options : FitOptions
        ``stages`` chooses the coefficients; ``inductance_H`` serves where there is no flux linkage.
    """
    if options.stages == "two":
        values = law.two_stage
        sides = tuple(side for function in law.stage_two for side in function.active_sides)
    else:
        values, sides = law.joint.x, law.limits.active_sides(law.joint)
    coefficients = []
    for n, (basis, power) in enumerate(law.terms):
        unit = law.law.coefficient_units[law.law.basis.index(basis)]
        half = 0.5 * float(law.interval.block[n, 1] - law.interval.block[n, 0])
        coefficients.append(
            Coefficient(
                basis=basis,
                current_power=power,
                value=float(values[n]),
                unit=f"{unit} A^-{power}" if power else unit,
                ci95=None if sides[n] else (float(values[n]) - half, float(values[n]) + half),
                bounds=(float(law.limits.lower[n]), float(law.limits.upper[n])),
                active=sides[n],
            )
        )
    bare = LawMagnetics(law.law.name, tuple(coefficients), dict(law.shape))
    if rows.flux_linkage is None:
        return LawMagnetics(law.law.name, tuple(coefficients), dict(law.shape), options.inductance_H or 0.0, 0.0)
    rest = rows.flux_linkage - bare.flux_linkage(rows.distance, rows.current)
    solution = solve_bounded_qp(
        np.stack([rows.current, np.ones_like(rows.current)], axis=1),
        rest,
        np.full_like(rest, 1e-3 * float(np.max(np.abs(rows.flux_linkage)))),
        lower=np.array([0.0, -np.inf]),
        names=("inductance", "flux linkage"),
    )
    return LawMagnetics(law.law.name, tuple(coefficients), dict(law.shape), float(solution.x[0]), float(solution.x[1]))


def _versions() -> dict[str, str]:
    return {
        "python": platform.python_version(),
        **{name: version(name) for name in ("femfit", "numpy", "scipy", "cvxpy", "osqp")},
    }
