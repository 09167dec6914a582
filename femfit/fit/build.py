"""From a sweep table to an actuator model: what ``femfit fit`` and ``femfit run`` call."""

import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

import numpy as np

from femfit.core.constants import GRAVITY
from femfit.core.errors import FitError
from femfit.core.sweep_table import SweepTable
from femfit.fit.bounded_qp import solve_bounded_qp
from femfit.fit.coenergy import CoenergyFit, fit_coenergy
from femfit.fit.hall import HallFit, fit_hall
from femfit.fit.law_fit import LawFit, default_bounds, fit_law
from femfit.fit.linearity import LinearityTest, linearity_test
from femfit.fit.misfit import misfit_between, misfit_to_rows
from femfit.fit.paper_box import bounds_by_name
from femfit.fit.result_data import coenergy_data, hall_data, law_data, linearity_data
from femfit.fit.rows import FitRows, rows_of_table
from femfit.laws.catalogue import law_by_name
from femfit.model.actuator_model import ActuatorModel, Circuit, HallSensor, Misfit, Motion, ValidityBox
from femfit.model.magnetics import Coefficient, LawMagnetics

COENERGY = "coenergy"


@dataclass(frozen=True)
class FitOptions:
    """What to fit and how.

    Parameters
    ----------
    model : str
        ``coenergy`` or a law's name.
    bounds : str
        ``law``, ``none``, ``paper`` or ``paper-coefficients``; see :mod:`femfit.fit.paper_box`.
    stages : str
        ``two`` puts the two-stage coefficients into the model, ``joint`` those of the one-stage fit.
    shapes : tuple of str or None
        Shape constraints of the co-energy; None: those that the raw data obey.
    inductance_H : float or None
        Inductance at the largest distance, for a table without flux linkage.
    actuator : mapping or None
        Replaces the manifest's ``actuator`` entry.
    mass_kg, resistance_ohm : float or None
        Replace single values of it.
    """

    model: str = COENERGY
    bounds: str = "law"
    stages: str = "two"
    shapes: tuple[str, ...] | None = None
    inductance_H: float | None = None
    actuator: Mapping[str, Any] | None = None
    mass_kg: float | None = None
    resistance_ohm: float | None = None


@dataclass(frozen=True, eq=False)
class FitResult:
    """A model and how it came about.

    Parameters
    ----------
    model : ActuatorModel
        To write with :func:`femfit.model.json_file.write_model`.
    coenergy : CoenergyFit
        The reference; the model itself where a co-energy was asked for.
    law : LawFit or None
        The law, where one was asked for.
    hall : HallFit or None
        Where the table has the field at a Hall element.
    linearity : LinearityTest or None
        Table 2 of the paper, on these data.
    misfits : tuple of Misfit
        Of the model, against the sweep first, then against the co-energy reference.
    rows : FitRows
        What was fitted.
    notes : tuple of str
        What the model lacks, and how to give it.
    data : mapping
        The same as JSON.
    """

    model: ActuatorModel
    coenergy: CoenergyFit | None
    law: LawFit | None
    hall: HallFit | None
    linearity: LinearityTest | None
    misfits: tuple[Misfit, ...]
    rows: FitRows
    notes: tuple[str, ...]
    data: Mapping[str, Any] = field(default_factory=dict)


def fit_model(table: SweepTable, options: FitOptions | None = None) -> FitResult:
    """Fit a model to a sweep table.

    Parameters
    ----------
    table : SweepTable
        Of the sweep or an import.
    options : FitOptions or None
        None for a co-energy with everything by default.

    Returns
    -------
    FitResult
        Model and report.

    Raises
    ------
    TableError
        If the table cannot be fitted at all.
    FitError
        If the fit has no accepted optimum; :class:`femfit.core.errors.InfeasibleFitError` if the bounds exclude all.
    """
    options = options or FitOptions()
    entry = actuator_entry(table, options)
    mass = entry.get("mass_kg")
    rows = rows_of_table(table, None if mass is None else float(mass), GRAVITY)
    hall = None if rows.hall is None or len(rows.currents) < 2 else fit_hall(rows, rows.hall)
    linearity = linearity_test(rows)
    coenergy: CoenergyFit | None
    law: LawFit | None = None
    if options.model == COENERGY:
        coenergy = fit_coenergy(rows, options.shapes, options.inductance_H or 0.0)
        magnetics: Any = coenergy.magnetics
        covariance = None
    else:
        chosen = law_by_name(options.model)
        bounds = bounds_by_name(options.bounds, chosen, rows) or default_bounds(chosen)
        law = fit_law(chosen, rows, bounds)
        magnetics = law_magnetics(law, rows, options)
        covariance = law.interval.block_covariance
        coenergy = _reference(rows, options)
    misfits = [misfit_to_rows(magnetics, rows, hall.rms_T if hall else None)]
    if law is not None and coenergy is not None:
        misfits.append(misfit_between(magnetics, coenergy.magnetics, rows))
    data = {
        "model": options.model,
        "rows": len(rows.force),
        "misfits": [vars(m) for m in misfits],
        "coenergy": coenergy_data(coenergy) if coenergy else None,
        "law": law_data(law, rows) if law else None,
        "hall": hall_data(hall) if hall else None,
        "linearity": linearity_data(linearity) if linearity else None,
    }
    circuit, motion, sensor, notes = _parts(entry, rows, hall, options)
    model = ActuatorModel(
        name=str(entry.get("name") or table.manifest.get("name") or "actuator"),
        magnetics=magnetics,
        validity=ValidityBox(
            float(rows.distances[0]), float(rows.distances[-1]), float(rows.currents[0]), float(rows.currents[-1])
        ),
        circuit=circuit,
        motion=motion,
        sensor=sensor,
        misfit=misfits[0],
        sample_time_s=float(entry.get("sample_time_s") or 0.5e-3),
        reference_distances_m=tuple(float(d) for d in entry.get("reference_distances_m") or ()),
        covariance=covariance,
        provenance={
            "fit": {**data, "notes": list(notes), "stages": options.stages, "bounds": options.bounds},
            "sweep": {k: v for k, v in table.manifest.items() if k != "actuator"},
            "versions": _versions(),
        },
    )
    return FitResult(model, coenergy, law, hall, linearity, tuple(misfits), rows, notes, data)


def actuator_entry(table: SweepTable, options: FitOptions) -> dict[str, Any]:
    """The manifest's actuator entry with the options' replacements.

    Parameters
    ----------
    table : SweepTable
        Any.
    options : FitOptions
        Any.

    Returns
    -------
    dict
        Keys as in :class:`femfit.core.sweep_table.SweepTable`.
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
    law : LawFit
        A fitted law.
    rows : FitRows
        Whose flux linkage gives the constants.
    options : FitOptions
        ``stages`` chooses the coefficients; ``inductance_H`` serves where there is no flux linkage.

    Returns
    -------
    LawMagnetics
        For the model.
    """
    values = law.two_stage if options.stages == "two" else law.joint.x
    coefficients = []
    for n, (basis, power) in enumerate(law.terms):
        k = law.law.basis.index(basis)
        active = law.stage_two[k].active if options.stages == "two" else law.joint_active
        sides = {side for side in ("lower", "upper") for word in active if basis in word and f"its {side}" in word}
        coefficients.append(
            Coefficient(
                basis=basis,
                current_power=power,
                value=float(values[n]),
                unit=law.law.coefficient_units[k] + ("" if power == 0 else " A^-1" if power == 1 else f" A^-{power}"),
                ci95=None if sides else _shifted(law.interval.block[n], law.joint.x[n], values[n]),
                active=" and ".join(sorted(sides)),
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


def _shifted(interval: Any, centre: float, value: float) -> tuple[float, float]:
    return float(interval[0] - centre + value), float(interval[1] - centre + value)


def _reference(rows: FitRows, options: FitOptions) -> CoenergyFit | None:
    """The co-energy reference of a law; None where the table is too small for one."""
    try:
        return fit_coenergy(rows, options.shapes, options.inductance_H or 0.0)
    except FitError:
        return None


def _parts(
    entry: Mapping[str, Any], rows: FitRows, hall: HallFit | None, options: FitOptions
) -> tuple[Circuit | None, Motion | None, HallSensor | None, tuple[str, ...]]:
    notes = []
    circuit = None
    keys = ("resistance_ohm", "voltage_min_V", "voltage_max_V")
    missing = [key for key in keys if entry.get(key) is None]
    if rows.flux_linkage is None and options.inductance_H is None:
        missing.append("flux_linkage_Wb or an inductance")
    if missing:
        notes.append(
            f"No circuit in the model: {', '.join(missing)} unknown. Give --actuator ACTUATOR.toml"
            + (", and --inductance-H since the table has no flux linkage." if rows.flux_linkage is None else ".")
        )
    else:
        circuit = Circuit(*(float(entry[key]) for key in keys))
    motion = None
    if entry.get("mass_kg") is None:
        notes.append("No motion in the model: mass unknown. Give --actuator ACTUATOR.toml or --mass-g.")
    else:
        motion = Motion(float(entry["mass_kg"]))
    sensor = None
    element = entry.get("hall")
    if hall is None or not element:
        notes.append("No sensor in the model: it needs hall_T in the table and [hall] in the actuator file.")
    else:
        values = {key: value for key, value in element.items() if key not in {"radius_m", "height_m"}}
        sensor = HallSensor(field=hall.field, **values)
    return circuit, motion, sensor, tuple(notes)


def _versions() -> dict[str, str]:
    return {
        "python": platform.python_version(),
        **{name: version(name) for name in ("femfit", "numpy", "scipy", "cvxpy", "osqp")},
    }
