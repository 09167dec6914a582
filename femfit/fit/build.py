"""From a sweep table to an actuator model: what ``femfit fit`` and ``femfit run`` call."""

import platform
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.errors import FitError, UsageError
from femfit.core.numerics import GRAVITY
from femfit.core.text import amount
from femfit.device.electrics import Circuit
from femfit.fit.circuits_fit import fit_circuits
from femfit.fit.coenergy import fit_coenergy, missed_between
from femfit.fit.constants import MAY_MISS, STORED
from femfit.fit.drawing import drawn_effects
from femfit.fit.eddy import with_eddy_currents
from femfit.fit.law_columns import default_bounds
from femfit.fit.law_fit import LawFit, fit_law
from femfit.fit.misfit import absent_points, as_written, import_notes, misfit_notes, misfit_to_rows, sheet_notes
from femfit.fit.model_parts import (
    actuator_entry,
    circuit_of,
    circuits_of,
    hall_sensor_of,
    kind_of,
    mechanics_of,
    one_sided,
    other_sensors_of,
    validity_of,
    with_period,
    within_sweep,
)
from femfit.fit.network_fit import better_network, fit_network
from femfit.fit.ranking import rank_laws
from femfit.fit.result import FitResult, Fits
from femfit.fit.rows import FitRows, rows_of_table
from femfit.fit.saturating_circuits import require_currents
from femfit.fit.sensed_field import HallFit, SensedRows, fit_hall, fit_pickups, fit_sensed
from femfit.laws.catalogue import all_laws, law_by_name
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import HallField
from femfit.model.network_magnetics import NETWORK
from femfit.model.validity import Misfit
from femfit.tables.sweep_table import SweepTable, read_sweep_table
from femfit.tables.variant_choice import choose_variant

COENERGY = "coenergy"


ALL = "all"


def fit_model(
    table: SweepTable | str | Path,
    *,
    law: str | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    functions: Sequence[str] | None = None,
    constraints: Sequence[str] | None = None,
    inductance_H: float | None = None,
    actuator: str | Path | Mapping[str, Any] | None = None,
    mass_kg: float | None = None,
    resistance_ohm: float | None = None,
    supply_V: tuple[float, float] | None = None,
    where: Mapping[str, float | str] | None = None,
) -> FitResult:
    """Fit a model to a sweep table.

    Parameters
    ----------
    table : SweepTable, str or Path
        A table, its file, or the directory that holds it.
    law : str or None
        A force law's name, ``all`` to rank every law and take the recommended one, or None for a co-energy.
    bounds : mapping of str to (float, float), or None
        Bounds of single columns' coefficients, at every current, in place of the law's own.
    functions : sequence of str or None
        Coefficient function of each of the law's columns; None to choose them by held-out error.
    constraints : sequence of str or None
        Shape constraints of the co-energy; None for those that the table obeys.
    inductance_H : float or None
        Inductance at the largest distance, for a table without flux linkage.
    actuator : str, Path, mapping or None
        Actuator file, or values in place of those that the table's manifest records of its actuator.
    mass_kg, resistance_ohm, supply_V : float, float, (float, float), or None
        Moving mass, winding resistance, and lowest and highest voltage of the driver, in place of the actuator's.
    where : mapping or None
        Which variant of a parameter sweep, by column and value.

    Raises
    ------
    UsageError
        If there is no such law, constraint or coefficient function, or a value is out of its range.
    TableError
        If the table cannot be fitted at all.
    FitError
        If the fit has no proven optimum, an option does not suit the model, or the model as it would be written is
        farther from the table than the fit.

    Examples
    --------
    >>> import femfit as ff
    >>> fit = ff.fit_model("runs/rig")
    >>> fit.misfit.force_rms_relative < 0.001
    True
    >>> ff.fit_model("runs/rig", law="dipole-disk").law.law.name
    'dipole-disk'
    """
    law = None if law == COENERGY else law
    _check_options(
        law, bounds, functions, {"mass_kg": mass_kg, "resistance_ohm": resistance_ohm, "inductance_H": inductance_H}
    )
    if not isinstance(table, SweepTable):
        table = read_sweep_table(table)
    table = choose_variant(table, dict(where or {}))
    entry = actuator_entry(table.manifest.get("actuator"), actuator, mass_kg, resistance_ohm, supply_V)
    kind, mechanics = kind_of(entry), mechanics_of(entry)
    mass, gravity = (mechanics.mass_kg, mechanics.gravity_m_s2) if mechanics else (None, GRAVITY)
    rows = rows_of_table(table, mass, gravity, kind)
    if rows.several and law is not None:
        raise UsageError(f"Several circuits take the co-energy alone; instead received model {law!r}.")
    if rows.several and kind is not None and kind.saturates:
        require_currents(rows, "The drawing's iron has a magnetisation curve")
    fits = (
        Fits(circuits=fit_circuits(rows))
        if rows.several
        else _fits(rows, law, bounds or {}, functions, constraints, inductance_H)
    )
    circuits, unknown = _circuits(entry, rows, inductance_H)
    validity, unswept = validity_of(fits.magnetics(rows, inductance_H), rows, bool(circuits))
    motion, unmoved = within_sweep(mechanics, rows.distances)
    field, hall, unsensed = _hall_field(entry, rows)
    other_sensors, not_held = other_sensors_of(entry, fit_pickups(table))
    drawn, missed_by = drawn_effects(None if rows.several else table.signatures, rows, fits.coenergy, hall)
    model = ActuatorModel(
        name=str(entry.get("name") or table.manifest.get("name") or "actuator"),
        magnetics=fits.magnetics(rows, inductance_H),
        validity=validity,
        circuits=circuits,
        motion=motion,
        sensor=hall_sensor_of(entry["hall"], field) if field and entry.get("hall") else None,
        reference_distances_m=tuple(float(d) for d in entry.get("reference_distances_m") or ()),
        covariance=fits.law.interval.block_covariance if fits.law else None,
        kind=kind,
        other_sensors=other_sensors,
        drawn=drawn,
    )
    model = with_period(with_eddy_currents(model, table), entry)
    built, model = misfit_to_rows(model, rows), replace(model, misfit=misfit_to_rows(as_written(model), rows))
    _require_as_fitted(model, built, fits.law)
    spline = None if fits.law or fits.network else fits.coenergy
    between = missed_between(spline, rows) if spline else None
    notes = (
        *unknown,
        *unswept,
        *absent_points(rows),
        *one_sided(circuits, validity),
        *unmoved,
        *not_held,
        *sheet_notes(table),
        *unsensed,
        *(fits.circuits.notes() if fits.circuits else misfit_notes(model, rows, spline, between)),
        *missed_by,
    )
    of_data = import_notes(table)
    result = FitResult(**vars(fits), model=model, hall=hall, rows=rows, notes=notes, of_data=of_data, between=between)
    if rows.several:
        return result.with_provenance(table.manifest)
    versions = {name: version(name) for name in ("femfit", "numpy", "scipy")}
    return result.with_provenance(table.manifest, versions={"python": platform.python_version(), **versions})


def _fits(
    rows: FitRows,
    law: str | None,
    bounds: Mapping[str, tuple[float, float]],
    functions: Sequence[str] | None,
    constraints: Sequence[str] | None,
    inductance_H: float | None,
) -> Fits:
    """The law, or the best of all, and the co-energy beside it; without that where a table is too small for it."""
    law_fit, ranking, network, coenergy = None, None, None, None
    if law == ALL:
        ranking = rank_laws(tuple(all_laws().values()), rows)
        network = None if ranking.reached else better_network(rows, ranking)
        law_fit = None if network else ranking.recommended.fit
    elif law == NETWORK:
        network = fit_network(rows)
    elif law is not None:
        named = law_by_name(law)
        law_fit = fit_law(named, rows, default_bounds(named).with_single(named, bounds), functions)
    try:
        coenergy = fit_coenergy(rows, constraints, inductance_H or 0.0)
    except FitError:
        if law_fit is None and network is None:
            raise
    return Fits(coenergy=coenergy, law=law_fit, ranking=ranking, network=network)


def _circuits(
    entry: Mapping[str, Any],
    rows: FitRows,
    inductance_H: float | None,
) -> tuple[tuple[Circuit, ...], tuple[str, ...]]:
    """The circuits, and what is unknown of them; a pair of magnets lacks none."""
    if rows.several:
        return circuits_of(entry, rows.names)
    circuits, unknown = circuit_of(entry, rows.flux_linkage is not None, inductance_H is not None)
    has_coil = not rows.without_current or entry.get("resistance_ohm") is not None
    return circuits, unknown if has_coil else ()


def _hall_field(entry: Mapping[str, Any], rows: FitRows) -> tuple[HallField | None, HallFit | None, tuple[str, ...]]:
    """The field at the Hall element, how one circuit's was fitted, and what is said of an element left out."""
    drawn = entry.get("hall")
    if not rows.several:
        one_current = len(rows.currents) < 2 and not rows.without_current
        hall = None if rows.hall is None or one_current else fit_hall(rows, rows.hall)
        field = None if hall is None else hall.field
        has_coil = not rows.without_current or entry.get("resistance_ohm") is not None
        if (hall and drawn) or not has_coil or entry.get("sensors"):
            return field, hall, ()
        how = "draw [sensors.NAME] in the actuator file; one of kind hall needs hall_T in the table as well."
        return field, hall, (f"No sensor in the model: {how}",)
    if not drawn:
        return None, None, ()
    if rows.hall is None:
        return None, None, ("The Hall element is not in the model: the table has no hall_T. Sweep the drawing again.",)
    try:
        sensed = fit_sensed(
            SensedRows(rows.distance, rows.circuit_currents, rows.hall), "The field at the Hall element"
        )
    except FitError as error:
        return None, None, (f"The Hall element is not in the model: {error}",)
    return sensed.field, None, (sensed.said("The field at the Hall element", "T"),)


def _check_options(
    law: str | None,
    bounds: Mapping[str, tuple[float, float]] | None,
    functions: Sequence[str] | None,
    positive: Mapping[str, float | None],
) -> None:
    if law not in {None, ALL, NETWORK, *all_laws()}:
        raise UsageError(
            f"The model must be {COENERGY}, {ALL} or a law ({', '.join([*all_laws(), NETWORK])}); instead received "
            f"{law!r}."
        )
    for_one_law = [name for name, value in (("bounds", bounds), ("functions", functions)) if value]
    if for_one_law and law in {None, ALL, NETWORK}:
        raise UsageError(
            f"{' and '.join(for_one_law)} can be given for one law only; instead received model {law or COENERGY!r}. "
            "Leave out the option or name a law."
        )
    for name, value in positive.items():
        if value is not None and not (np.isfinite(value) and value > 0):
            raise UsageError(f"{name} must be > 0; instead received {value:g}.")


def _require_as_fitted(written: ActuatorModel, built: Misfit, law: LawFit | None) -> None:
    """Refuse a model whose file, read back, is farther from the table than the fit that it is named after."""
    misfit = written.misfit
    assert misfit is not None  # noqa: S101  set by the caller
    name = "the co-energy" if law is None else law.law.name
    force = built.force_rms_N if law is None else float(np.sqrt(np.mean(law.joint.residual**2)))
    for quantity, unit, written_rms, fitted, share in (
        ("force", "N", misfit.force_rms_N, force, misfit.force_share),
        ("flux linkage", "Wb", misfit.flux_linkage_rms_Wb, built.flux_linkage_rms_Wb, misfit.flux_linkage_share),
        ("inductance", "H", misfit.inductance_rms_H, built.inductance_rms_H, misfit.inductance_share),
    ):
        if written_rms is None or fitted is None:
            continue
        if written_rms > MAY_MISS * fitted and (share is None or share > STORED):
            raise FitError(
                f"The model of {name} is not written: read back it misses the table's {quantity} by "
                f"{amount(written_rms, unit, 3)} rms, and the fit by {amount(fitted, unit, 3)}. The law's columns and "
                "potential_columns contradict each other, or its numbers are too ill-conditioned to be stored. Take "
                "another law, or the co-energy."
            )
