"""How far a model is from its table, that of the file as it is read back, and what the user is told of it."""

import json
from collections.abc import Mapping, Sequence

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.text import amount
from femfit.device.parts import thick_sheets
from femfit.device.summary import actuator_from_record
from femfit.fit.coenergy import Between, CoenergyFit
from femfit.fit.constants import COARSE, POOR_CIRCUIT
from femfit.fit.rows import FitRows, rms, rms_share
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_from_dict, model_to_dict
from femfit.model.magnetics import CoenergySpline, Magnetics
from femfit.model.validity import Misfit
from femfit.tables.sweep_table import SweepTable


def as_written(model: ActuatorModel) -> ActuatorModel:
    """The model as its file holds it, read back."""
    return model_from_dict(json.loads(json.dumps(model_to_dict(model))))


def misfit_to_rows(model: ActuatorModel | Magnetics, rows: FitRows) -> Misfit:
    """Model minus table in force, flux linkage and, with a sensor, the field at the Hall element.

    Beside those, of one circuit, the inductance. Of several, the rms misfit of all flux linkages together, and the
    largest of the circuits' shares, each of its own rms.
    """
    sensor = model.sensor if isinstance(model, ActuatorModel) else None
    magnetics = model.magnetics if isinstance(model, ActuatorModel) else model
    error = magnetics.force(rows.distance, rows.circuit_currents) - rows.force
    flux_rms = flux_share = inductance_rms = inductance_share = hall_rms = None
    if rows.flux_linkage is not None:
        linked = magnetics.flux_linkage(rows.distance, rows.circuit_currents)
        missed = linked - rows.flux_linkage
        flux_rms = rms(missed)
        flux_share = rms_share(missed, rows.flux_linkage)
    if rows.flux_linkage is not None and not rows.several:
        table, of_model = (chord_inductance(rows, flux[:, 0]) for flux in (rows.flux_linkage, linked))
        if len(table):
            inductance_rms, inductance_share = rms(of_model - table), rms_share(of_model - table, table)
    if sensor is not None and rows.hall is not None:
        hall_rms = rms(sensor.field.field(rows.distance, rows.circuit_currents) - rows.hall)
    return Misfit(
        force_rms_N=rms(error),
        force_max_N=float(np.max(np.abs(error))),
        force_rms_relative=rms(error / rows.force_scale),
        force_rms_of_weight=None if rows.hanging_weight is None else rms(error) / rows.hanging_weight,
        flux_linkage_rms_Wb=flux_rms,
        hall_rms_T=hall_rms,
        rows=len(error),
        against="sweep",
        inductance_rms_H=inductance_rms,
        force_share=rms_share(error, rows.force),
        flux_linkage_share=flux_share,
        inductance_share=inductance_share,
    )


def chord_inductance(rows: FitRows, flux_linkage: FloatArray) -> FloatArray:
    """Change of flux linkage over that of current, from each current to the next at the same distance."""
    order = np.lexsort((rows.current, rows.distance))
    same = np.diff(rows.distance[order]) == 0.0
    return np.asarray((np.diff(flux_linkage[order])[same]) / (np.diff(rows.current[order])[same]))


_UNITS_ASSUMED = "assumed-units"


def import_notes(table: SweepTable) -> tuple[str, ...]:
    """What an import warned of, and units that it assumed: a fit is wrong by the factor that they are."""
    findings = [finding for finding in table.manifest.get("findings") or () if isinstance(finding, dict)]
    grave = [
        finding for finding in findings if finding.get("severity") == "warning" or finding.get("code") == _UNITS_ASSUMED
    ]
    return tuple(
        f"{finding.get('text', finding.get('sentence', ''))} {finding.get('remedy', '')}".strip() for finding in grave
    )


def sheet_notes(table: SweepTable) -> tuple[str, ...]:
    """Where eddy currents hold to a lower frequency than was swept: sheets of the drawing that are too thick."""
    drawn = table.manifest.get("inputs")
    if table.eddy is None or not isinstance(drawn, Mapping):
        return ()
    return tuple(thick_sheets(actuator_from_record(drawn, str(table.manifest.get("name") or "the sweep"))))


def absent_points(rows: FitRows) -> tuple[str, ...]:
    """What points that the grid of several currents lacks mean for the co-energy between the others."""
    absent = rows.grid_points - len(rows.distance)
    if absent <= 0 or not rows.several:
        return ()
    return (
        (
            f"{absent} of the {rows.grid_points} points of the grid failed or are missing, and the co-energy is less "
            "sure around them. Mend what made them fail, or move these points, and sweep again before anything else."
        ),
    )


def misfit_notes(
    model: ActuatorModel, rows: FitRows, coenergy: CoenergyFit | None, between: Between | None = None
) -> tuple[str, ...]:
    """Warnings where the model misses the table that it was fitted to.

    Parameters
    ----------
    model : ActuatorModel
        With its misfit.
    rows : FitRows
        The table's.
    coenergy : CoenergyFit or None
        The model, where it is one.
    between : Between or None
        What a co-energy may be off by between the points.
    """
    misfit = model.misfit
    assert misfit is not None  # noqa: S101  every fit computes it
    notes = []
    if coenergy is not None:
        notes += _finer_sweep(coenergy.missed_N, misfit, rows)
    if not notes and between is not None and between.poor:
        notes.append(f"The steps of the sweep are too wide for a bend of the steel. {to_be_added(between.finer)}")
    poor = [
        f"{name} by {amount(share, '')}"
        for name, share in (
            ("flux linkage", misfit.flux_linkage_share),
            ("inductance", misfit.inductance_share),
        )
        if share is not None and share > POOR_CIRCUIT
    ]
    if poor:
        remedy = "A co-energy (femfit fit without --model) holds both."
        if isinstance(model.magnetics, CoenergySpline) and rows.flux_linkage is not None:
            off = model.magnetics.flux_linkage(rows.distance, rows.circuit_currents)[:, 0] - rows.flux_linkage[:, 0]
            more = middles(rows.currents, rows.current[np.argmax(np.abs(off))])
            finer = " and ".join(f"{x:.4g}" for x in more)
            wanted = f"Add to [sweep] the currents {finer} A" if len(more) else "Give [sweep] more than one current"
            remedy = f"{wanted}, then sweep and fit again."
        notes.append(f"The model misses the table's {' and '.join(poor)}: do not simulate its circuit. {remedy}")
    return tuple(notes)


def _finer_sweep(missed: FloatArray, misfit: Misfit, rows: FitRows) -> list[str]:
    """Where a co-energy's force is least certain, and the distances and currents that halve the intervals around it.

    Of iron that saturates that is where a point left out is missed most, whatever the misfit to all points says.

    The largest error in newtons is asked for even where errors relative to each point's own force are what is poor:
    points added there also help between the points, where points added at the smallest forces do not.
    """
    shares = (
        (rms_share(missed, rows.force) or 0.0, "its rms"),
        (misfit.force_rms_relative, "each point's own force (rms)"),
    )
    poor = next((pair for pair in shares if pair[0] >= COARSE), None)
    if poor is None:
        return []
    worst, finer = int(np.argmax(missed)), finer_settings(missed, rows)
    d, i = rows.distance[worst], rows.current[worst]
    where = " with inner points left out" if rows.saturates and poor is shares[0] else ""
    return [
        (
            f"The sweep is too coarse for its force: the co-energy misses it by {amount(poor[0], '')} of {poor[1]}"
            f"{where}, most at {1e3 * d:.4g} mm and {i:.4g} A, and a diagnosis inherits that. {to_be_added(finer)}"
        )
    ]


def finer_settings(missed: FloatArray, rows: FitRows) -> dict[str, list[float]]:
    """The ``distance_m`` and ``current_A`` that halve the intervals around the largest error of the force."""
    worst = int(np.argmax(missed))
    around = {"distance_m": (rows.distances, rows.distance[worst]), "current_A": (rows.currents, rows.current[worst])}
    return {name: middles(axis, place).tolist() for name, (axis, place) in around.items()}


def middles(axis: FloatArray, place: float) -> FloatArray:
    """The middles of the intervals on both sides of a value of an axis."""
    k = int(np.searchsorted(axis, place))
    around = axis[max(k - 1, 0) : k + 2]
    return np.asarray(0.5 * (around[1:] + around[:-1]))


def to_be_added(finer: Mapping[str, Sequence[float]]) -> str:
    """What to do with finer settings, in a sentence."""
    axes = (("distances", 1e3 * np.array(finer["distance_m"]), "mm"), ("currents", finer["current_A"], "A"))
    parts = [f"the {name} {' and '.join(f'{x:.4g}' for x in axis)} {unit}" for name, axis, unit in axes if len(axis)]
    return f"Add to [sweep] {' and '.join(parts)}, then sweep and fit again."
