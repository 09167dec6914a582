"""From a sweep table to an actuator model: what ``femfit fit`` and ``femfit run`` call."""

import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.errors import FitError, UsageError
from femfit.core.numerics import GRAVITY
from femfit.fit.circuits_fit import fit_circuits, require_currents
from femfit.fit.coenergy import fit_coenergy
from femfit.fit.drawing import drawn_effects
from femfit.fit.eddy import with_eddy_currents
from femfit.fit.law_fit import fit_law
from femfit.fit.model_parts import (
    actuator_entry,
    circuits_of,
    hall_sensor_of,
    kind_of,
    mechanics_of,
    other_sensors_of,
    period_of,
    sample_time,
    validity_of,
    within_sweep,
)
from femfit.fit.ranking import as_written, between_points, import_notes, misfit_notes, misfit_to_rows, rank_laws
from femfit.fit.result import FitResult, Fits
from femfit.fit.rows import FitRows, rms, rows_of_table
from femfit.fit.sensed_field import HallFit, SensedFit, fit_hall, fit_pickups, sensed_or_why
from femfit.fit.soft_iron import fit_network
from femfit.fit.words import note
from femfit.laws.catalogue import all_laws, law_by_name
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import HallField
from femfit.model.several_magnetics import NETWORK
from femfit.tables.sweep_table import SweepTable, choose_variant, read_sweep_table

COENERGY, ALL = "coenergy", "all"


def fit_model(
    table: SweepTable | str | Path,
    *,
    law: str | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    functions: Sequence[str] | None = None,
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
        Bounds of one of the law's coefficients, at every current, in place of the law's own, as ``{"d^-4": (0,
        1e-8)}``.
    functions : sequence of str or None
        Coefficient functions of the current, one for each of the law's columns, for example constant,through-origin; by
        default chosen by held-out error among constant, through-origin, square, affine and quadratic.
    inductance_H : float or None
        Inductance at the largest distance, for a table without flux linkage.
    actuator : str, Path, mapping or None
        Actuator file with circuit, mass and sensor, for an imported table, or values in place of those that the table's
        manifest records.
    mass_kg : float or None
        Mass of the moving part, in place of the actuator's.
    resistance_ohm : float or None
        Resistance of the winding, in place of the actuator's.
    supply_V : (float, float) or None
        Lowest and highest voltage of the driver, in place of the actuator's, as ``(0, 12)``.
    where : mapping of str to float or str, or None
        Variant of a parameter sweep, as ``{"variant": 3}``, ``{"coil.turns": 250}`` or
        ``{"moving.regions.plunger.material": "steel_1010"}``.

    Raises
    ------
    UsageError
        If there is no such law or coefficient function, or a value is out of its range.
    TableError
        If the table cannot be fitted at all.
    FitError
        If the fit has no proven optimum, or an option does not suit the model.

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
    if law not in {None, ALL, NETWORK, *all_laws()}:
        raise UsageError(
            f"The model must be {COENERGY}, {ALL} or a law ({', '.join([*all_laws(), NETWORK])}); instead received "
            f"{law!r}."
        )
    if (bounds or functions) and law in {None, ALL, NETWORK}:
        raise UsageError(
            f"Bounds and functions can be given for one law only; instead received model {law or COENERGY!r}. Leave "
            "them out or name a law."
        )
    for name, value in {"mass_kg": mass_kg, "resistance_ohm": resistance_ohm, "inductance_H": inductance_H}.items():
        if value is not None and not (np.isfinite(value) and value > 0):
            raise UsageError(f"{name} must be > 0; instead received {value:g}.")
    if not isinstance(table, SweepTable):
        table = read_sweep_table(table)
    table = choose_variant(table, dict(where or {}))
    entry = actuator_entry(table.manifest.get("actuator"), actuator, mass_kg, resistance_ohm, supply_V)
    kind, rows = kind_of(entry), swept_rows(table, entry)
    if rows.several and law is not None:
        raise UsageError(f"Several circuits take the co-energy alone; instead received model {law!r}.")
    if rows.several and kind is not None and kind.saturates:
        require_currents(rows, "The drawing's iron has a magnetisation curve")
    fits = Fits(circuits=fit_circuits(rows)) if rows.several else _fits(rows, law, bounds, functions, inductance_H)
    has_coil = rows.several or not rows.without_current or entry.get("resistance_ohm") is not None
    circuits, unknown = circuits_of(entry, rows.names, rows.flux_linkage is not None, inductance_H is not None)
    magnetics = fits.magnetics(inductance_H)
    motion, unmoved = within_sweep(mechanics_of(entry), rows.distances)
    field, hall, unsensed = _hall_field(entry, rows, has_coil)
    other_sensors, not_held = other_sensors_of(entry, fit_pickups(table))
    drawn = drawn_effects(None if rows.several else table.signatures, rows, fits.coenergy, hall)
    model = ActuatorModel(
        name=str(entry.get("name") or table.manifest.get("name") or "actuator"),
        magnetics=magnetics,
        validity=validity_of(magnetics, rows, bool(circuits)),
        circuits=circuits,
        motion=motion,
        sensor=hall_sensor_of(entry["hall"], field) if field and entry.get("hall") else None,
        reference_distances_m=tuple(float(d) for d in entry.get("reference_distances_m") or ()),
        covariance=fits.law.covariance if fits.law else None,
        kind=kind,
        other_sensors=other_sensors,
        drawn=drawn,
    )
    model = with_eddy_currents(model, table)
    model = replace(model, sample_time_s=period_of(entry) or sample_time(model))
    between = between_points(fits.spline, rows) if fits.spline else None
    misfit = replace(misfit_to_rows(as_written(model), rows), between=between)
    model = replace(model, misfit=misfit)
    notes = (
        *(unknown if has_coil else ()),  # a pair of magnets lacks none
        *unmoved,
        *not_held,
        *unsensed,
        *(fits.circuits.notes() if fits.circuits else misfit_notes(misfit, magnetics)),
    )
    result = FitResult(**vars(fits), model=model, hall=hall, rows=rows, notes=notes, of_data=import_notes(table))
    provenance = {
        "fit": result.to_dict(),
        "sweep": {key: value for key, value in table.manifest.items() if key != "actuator"},
        "versions": {"python": platform.python_version()}
        | {name: version(name) for name in ("femfit", "numpy", "scipy")},
    }
    return replace(result, model=replace(model, provenance=provenance))


def swept_rows(table: SweepTable, entry: Mapping[str, Any]) -> FitRows:
    """The rows of a table, with the weight and the kind of the actuator that its manifest's entry describes."""
    mechanics = mechanics_of(entry)
    mass, gravity = (mechanics.mass_kg, mechanics.gravity_m_s2) if mechanics else (None, GRAVITY)
    return rows_of_table(table, mass, gravity, kind_of(entry))


def _fits(
    rows: FitRows,
    law: str | None,
    bounds: Mapping[str, tuple[float, float]] | None,
    functions: Sequence[str] | None,
    inductance_H: float | None,
) -> Fits:
    """The law, or the best of all, and the co-energy beside it; without that where a table is too small for it."""
    law_fit, ranking, network, coenergy = None, None, None, None
    if law == ALL:
        ranking = rank_laws(tuple(all_laws().values()), rows)
        if not ranking.reached:
            with suppress(FitError):
                network = fit_network(rows)
        if network is None or network.left_out * rms(rows.force) >= ranking.recommended.error * rows.error_scale[0]:
            network, law_fit = None, ranking.recommended.fit
    elif law == NETWORK:
        network = fit_network(rows)
    elif law is not None:
        law_fit = fit_law(law_by_name(law), rows, bounds, functions)
    try:
        coenergy = fit_coenergy(rows, inductance_H or 0.0)
    except FitError:
        if law_fit is None and network is None:
            raise
    return Fits(coenergy=coenergy, law=law_fit, ranking=ranking, network=network)


def _hall_field(
    entry: Mapping[str, Any], rows: FitRows, has_coil: bool
) -> tuple[HallField | None, HallFit | None, tuple[str, ...]]:
    """The field at the Hall element, how one circuit's was fitted, and what is said of an element left out."""
    drawn, hall = entry.get("hall"), None
    if not rows.several:
        if rows.hall is not None and (len(rows.currents) > 1 or rows.without_current):
            hall = fit_hall(rows, rows.hall)
        lacking = has_coil and not (hall and drawn) and not entry.get("sensors")
        return hall.field if hall else None, hall, (note("no_sensor"),) if lacking else ()
    if not drawn:
        return None, None, ()
    what = "The field at the Hall element"
    sensed: SensedFit | str = "no hall_T"
    if rows.hall is not None:
        sensed = sensed_or_why(rows.distance, rows.circuit_currents, rows.hall, what)
    field = None if isinstance(sensed, str) else sensed.field
    return field, None, (note("sensed", sensed, what, "T", "The Hall element"),)
