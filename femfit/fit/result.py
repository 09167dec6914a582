"""What a fit gives: the model, how it came about, and both as text and JSON-ready data."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from femfit.core.results import Printed
from femfit.core.text import amount, counted
from femfit.fit.circuits_fit import CircuitsFit
from femfit.fit.coenergy import SHAPES, Between, CoenergyFit, splines_of_current
from femfit.fit.law_fit import LawFit
from femfit.fit.misfit import finer_settings
from femfit.fit.network_fit import NetworkFit
from femfit.fit.ranking import Ranking
from femfit.fit.rows import FitRows, rms
from femfit.fit.sensed_field import HallFit
from femfit.model.actuator_model import ActuatorModel
from femfit.model.model_text import eddy_line, fit_lines
from femfit.model.network_magnetics import NETWORK, OPERATIONS
from femfit.model.validity import Misfit

_FINE = 101
"""Numerical: so many distances and currents are looked at between the sweep's points."""

_LABELS_SHOWN = 4
"""So many active constraints are listed; more are counted."""


@dataclass(frozen=True, eq=False, repr=False)
class FitResult(Printed):
    """A model and how it came about.

    Parameters
    ----------
    model : ActuatorModel
        Its ``misfit`` is that of its file, read back, to the table.
    coenergy : CoenergyFit or None
        The model itself where no law was asked for; None where the table is too small for one.
    law : LawFit or None
        The law, where one was asked for or recommended.
    ranking : Ranking or None
        Where all laws were asked for.
    hall : HallFit or None
        Where the table has the field at a Hall element.
    notes : tuple of str
        What the model lacks, and how to give it.
    of_data : tuple of str
        What the table's import warned of.
    network : NetworkFit or None
        The law of a plunger that saturates, where it was asked for or is better than every other law.
    circuits : CircuitsFit or None
        The quadratic form of several circuits; ``rows`` then has the first one's currents and flux linkages.
    between : Between or None
        Of a co-energy whose iron saturates: what it may be off by between the table's points.

    Examples
    --------
    >>> import femfit as ff
    >>> print(ff.fit_model("runs/rig"))
    emaws-rig: co-energy
    it misses its table of 50 points by...
    """

    model: ActuatorModel
    coenergy: CoenergyFit | None
    law: LawFit | None
    ranking: Ranking | None
    hall: HallFit | None
    rows: FitRows
    notes: tuple[str, ...]
    of_data: tuple[str, ...] = ()
    network: NetworkFit | None = None
    circuits: CircuitsFit | None = None
    between: Between | None = None

    @property
    def misfit(self) -> Misfit:
        """The misfit of the model as it is written, to its table."""
        assert self.model.misfit is not None  # noqa: S101  every fit computes it
        return self.model.misfit

    def with_provenance(self, manifest: Mapping[str, Any], **more: Any) -> "FitResult":
        """The result whose model holds it as data beside the sweep's manifest."""
        sweep = {key: value for key, value in manifest.items() if key != "actuator"}
        provenance = {"fit": self.to_dict(), "sweep": sweep, **more}
        return replace(self, model=replace(self.model, provenance=provenance))

    def __str__(self) -> str:
        """The lines that ``femfit fit`` prints, the answer first."""
        return "\n".join(_lines(self))

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data: for ``--json`` and the model's provenance."""
        spline = None if self.law or self.network else self.coenergy
        return {
            "model": self.law.law.name if self.law else NETWORK if self.network else "coenergy",
            "rows": len(self.rows.force),
            "misfit": asdict(self.misfit),
            "coenergy": _coenergy_data(self.coenergy) if self.coenergy else None,
            "law": _law_data(self.law) if self.law else None,
            "network": {"operations": OPERATIONS, "left_out_of_rms": self.network.left_out} if self.network else None,
            "circuits": list(self.circuits.magnetics.names) if self.circuits else None,
            "ranking": self.ranking.to_dict() if self.ranking else None,
            "hall": _hall_data(self.hall) if self.hall else None,
            "between_points": asdict(self.between) if self.between else None,
            "finer_sweep": finer_settings(spline.missed_N, self.rows) if spline else None,
            "notes": [*self.of_data, *self.notes],
        }


def _lines(result: FitResult) -> list[str]:
    lines = [
        *fit_lines(result.model),
        *([] if result.between is None else [str(result.between)]),
        *([] if result.model.eddy is None else [eddy_line(result.model, result.model.eddy)]),
        *(f"note: {note}" for note in (*result.of_data, *result.notes)),
    ]
    if result.circuits is not None:
        return [*lines, *result.circuits.lines()]
    if not result.rows.without_current:
        lines.append(_derived_line(result))
    if result.network is not None:
        lines += result.network.lines()
    if result.ranking is not None:
        lines += result.ranking.lines()[1 if result.network else 0 :]
    elif result.law is not None:
        lines += _law_lines(result.law)
    elif result.coenergy is not None and result.network is None:
        lines += _coenergy_lines(result.coenergy, result.rows)
    if result.hall is not None:
        lines += _hall_lines(result.hall, result.model)
    return lines


def _derived_line(result: FitResult) -> str:
    swept = result.rows.distance, result.rows.current
    d, i = (np.concatenate(pair) for pair in zip(swept, result.model.validity.grid(_FINE, _FINE), strict=True))
    state = result.model.magnetics.state(d, i)
    text = f"motional constant dF/di {state.motional_constant.min():.4g} to {state.motional_constant.max():.4g} N/A"
    if result.model.circuit is None and result.rows.flux_linkage is None:
        return f"{text}; inductance unknown (no flux linkage in the table)"
    return f"{text}; inductance {amount(state.inductance.min(), 'H', 4)} to {amount(state.inductance.max(), 'H', 4)}"


def _coenergy_lines(fit: CoenergyFit, rows: FitRows) -> list[str]:
    text = f"B-spline of {fit.basis.shape[0]} x {fit.basis.shape[1]} coefficients (distance x current)"
    if rows.rms_force:
        off = amount(rms(fit.left_out_N) / rows.rms_force, "")
        text += f"; with each inner point left out in turn it misses the force by {off}"
    return [
        text,
        *(f"constraint: {SHAPES[name]}" for name in fit.constraints),
        f"active constraints: {_active(fit.active)}",
    ]


def _active(labels: Sequence[str]) -> str:
    if len(labels) <= _LABELS_SHOWN:
        return "; ".join(labels) or "none"
    counts = Counter(label.partition(" at ")[0] for label in labels)
    return "; ".join(f"{name} at {counted(count, 'place')}" for name, count in counts.items())


def _law_lines(fit: LawFit) -> list[str]:
    lines = [f"coefficients of {fit.law.name} (95 % intervals from leaving out blocks of distances):"]
    units = {parameter.name: parameter.unit for parameter in fit.law.shape}
    for name, value in fit.shape.items():
        low, high = fit.shape_interval[name]
        lines.append(f"  {name:20} {value:13.5g}   {low:.5g} .. {high:.5g} {units[name]}")
    sides = fit.limits.active_sides(fit.joint)
    for n, (basis, power) in enumerate(fit.terms):
        unit = fit.law.coefficient_units[fit.law.basis.index(basis)] + (f" A^-{power}" if power else "")
        low, high = fit.interval.block[n]
        free = low < 0.0 < high and not sides[n]
        shown = "not determined by this table:" if free else f"{fit.joint.x[n]:13.5e}  "
        lines.append(f"  {_term(basis, power):20} {shown} {low:.5e} .. {high:.5e} {unit}")
    active = fit.limits.active(fit.joint)
    return [*lines, *(f"  on its bound: {_active(active)}" for _ in active[:1])]


def _term(basis: str, power: int) -> str:
    return basis if power == 0 else f"{basis} i" if power == 1 else f"{basis} i^{power}"


def _hall_lines(hall: HallFit, model: ActuatorModel) -> list[str]:
    low, high = hall.coil_slope_T_per_A
    far, near = hall.magnet_field_T
    volt = ""
    if model.sensor is not None:
        per_tesla = model.sensor.sensitivity_V_per_T
        volt = (
            f" ({per_tesla * low:.3g} to {per_tesla * high:.3g} V/A, {per_tesla * far:.3g} to {per_tesla * near:.3g} V)"
        )
    return [
        (
            f"field at the Hall element: coil {amount(low, 'T/A', 4)} to {amount(high, 'T/A', 4)}, without "
            f"current {amount(far, 'T', 4)} to {amount(near, 'T', 4)}{volt}; misfit {amount(hall.rms_T, 'T', 3)} rms"
        )
    ]


def _coenergy_data(fit: CoenergyFit) -> dict[str, Any]:
    splines = splines_of_current(fit.basis)
    return {
        "coefficients": fit.basis.size,
        "cells": [fit.basis.u_cells, *splines.cells],
        "current_degree": splines.degrees[0],
        "held_out_relative_rms": fit.held_out,
        "left_out_force_rms_N": rms(fit.left_out_N),
        "constraints": list(fit.constraints),
        "active": list(fit.active),
        "condition_scaled": fit.qp.condition_scaled,
    }


def _law_data(fit: LawFit) -> dict[str, Any]:
    return {
        "name": fit.law.name,
        "formula": fit.law.formula,
        "operations": fit.operations,
        "shape": dict(fit.shape),
        "shape_interval95": {name: list(ends) for name, ends in fit.shape_interval.items()},
        "functions": dict(zip(fit.law.basis, fit.functions, strict=True)),
        "terms": [
            {
                "column": basis,
                "current_power": power,
                "value": float(fit.joint.x[n]),
                "interval95": fit.interval.block[n].tolist(),
            }
            for n, (basis, power) in enumerate(fit.terms)
        ],
        "active": list(fit.limits.active(fit.joint)),
        "condition_scaled": fit.joint.condition_scaled,
    }


def _hall_data(fit: HallFit) -> dict[str, Any]:
    return {
        "coil_slope_T_per_A": list(fit.coil_slope_T_per_A),
        "magnet_field_T": list(fit.magnet_field_T),
        "rms_T": fit.rms_T,
        "max_T": fit.max_T,
        "held_out_of_range": fit.held_out,
        "coefficients": int(fit.field.spline.coefficients.size),
    }
