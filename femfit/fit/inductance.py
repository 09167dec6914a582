"""A model from measured inductances: an attracting law whose forces are what the inductance's slope makes them.

Iron that does not saturate has W'(d, i) = L(d) i^2 / 2, so that L(d) = L_0 + 2 sum_k a_k Phi_k(d) gives the force
i^2 sum_k a_k phi_k(d) without any force having been measured. With a_k >= 0 the inductance falls with the distance and
the force attracts, as with every piece of soft iron.

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 3.1.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.errors import FitError, UsageError
from femfit.core.numerics import FloatArray
from femfit.core.results import Printed
from femfit.core.text import counted
from femfit.fit.bounded_qp import non_negative
from femfit.fit.constants import POOR_CIRCUIT
from femfit.fit.law_fit import search_shape
from femfit.fit.misfit import as_written
from femfit.fit.model_parts import MASS_UNKNOWN, actuator_entry, circuit_of, mechanics_of, sample_time
from femfit.fit.printed import printed
from femfit.fit.rows import rms
from femfit.laws.catalogue import law_by_name
from femfit.laws.law import ForceLaw
from femfit.model.actuator_model import ActuatorModel
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.model.validity import ValidityBox
from femfit.tables.measured_tables import InductanceTable


@dataclass(frozen=True, eq=False, repr=False)
class InductanceFit(Printed):
    """A model and how far it is from the inductances."""

    model: ActuatorModel
    # Root mean square and largest of model minus table
    rms_H: float
    max_H: float
    rows: int
    notes: tuple[str, ...]  # What the model lacks, and how to give it
    of_data: tuple[str, ...] = ()  # What was left out of the table or converted

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data, without the model."""
        return {"rows": self.rows, "rms_H": self.rms_H, "max_H": self.max_H, "notes": [*self.of_data, *self.notes]}

    def __str__(self) -> str:
        """The lines that ``femfit fit`` prints, the answer first."""
        magnetics, domain = self.model.magnetics, self.model.validity
        ends = np.array([domain.distance_min_m, domain.distance_max_m])
        return printed(
            "inductance.txt.j2",
            result=self,
            distances_mm=1e3 * ends,
            inductance_mH=1e3 * magnetics.inductance(ends, np.ones((2, 1)))[:, 0, 0],
            current_A=domain.current_max_A,
            force_N=magnetics.force(ends, np.full((2, 1), domain.current_max_A)),
        )


def fit_inductance(
    table: InductanceTable,
    *,
    law: str = "two-exponentials",
    mass_kg: float | None = None,
    resistance_ohm: float | None = None,
    supply_V: tuple[float, float] | None = None,
    actuator: str | Path | None = None,
) -> InductanceFit:
    """Fit a force law to measured inductances.

    The supply is the driver's lowest and highest voltage; an actuator file gives what is not given itself.
    """
    if law in {"coenergy", "all"}:
        raise UsageError(
            f"Inductances without forces give a law; --model must name one, for example two-exponentials, "
            f"instead of {law}."
        )
    entry = actuator_entry(None, actuator, mass_kg, resistance_ohm, supply_V)
    chosen = law_by_name(law)
    distances = np.unique(table.distance)
    numbers = 1 + len(chosen.basis) + len(chosen.shape)
    if len(distances) < numbers:
        raise FitError(
            f"Law {chosen.name} has {counted(numbers, 'number')} and needs as many distances; {table.source} has "
            f"{len(distances)}. Measure at more distances, or take a simpler law."
        )
    _require_falling(table)
    scale = float(np.max(np.abs(table.inductance * table.current)))
    shape = search_shape(chosen, lambda trial: _linear(chosen, trial, table)[1] / scale)
    solution, _ = _linear(chosen, shape, table)
    coefficients = tuple(
        Coefficient(basis, 2, float(value), f"{unit} A^-2", bounds=(0.0, np.inf), active="" if value > 0.0 else "lower")
        for basis, unit, value in zip(chosen.basis, chosen.coefficient_units, solution[1:], strict=True)
    )
    magnetics = LawMagnetics(chosen.name, coefficients, shape, constant_inductance_H=float(solution[0]))
    (circuits, notes), motion = circuit_of(entry), mechanics_of(entry)
    notes = notes if motion else (*notes, MASS_UNKNOWN)
    model = ActuatorModel(
        name=table.source.rpartition(".")[0] or table.source,
        magnetics=magnetics,
        validity=ValidityBox.of_currents(
            (float(distances[0]), float(distances[-1])),
            (min(0.0, float(table.current.min())), float(table.current.max())),
        ),
        circuits=circuits,
        motion=motion,
        provenance={
            "fit": {"inductances": table.source, "rows": len(table.inductance), "law": chosen.name},
            "versions": {"femfit": version("femfit")},
        },
    )
    model = as_written(replace(model, sample_time_s=sample_time(model)))
    error = model.magnetics.inductance(table.distance, table.current[:, None])[:, 0, 0] - table.inductance
    if rms(error) > POOR_CIRCUIT * float(np.ptp(table.inductance)):
        notes = (
            *notes,
            (
                f"The model misses {100 * rms(error) / float(np.ptp(table.inductance)):.2g} % of the inductance's "
                "change with the distance, and its force by as much. Take another law, or check the distances."
            ),
        )
    findings = tuple(map(str, table.findings))
    return InductanceFit(model, rms(error), float(np.abs(error).max()), len(error), notes, findings)


def _require_falling(table: InductanceTable) -> None:
    """Refuse inductances that grow with the distance: soft iron is drawn to where the inductance is larger."""
    slope = np.polyfit(table.distance - table.distance.mean(), table.inductance, 1)[0]
    if slope < 0.0:
        return
    near, far = (
        1e3 * float(np.mean(table.inductance[table.distance == end]))
        for end in (table.distance.min(), table.distance.max())
    )
    raise FitError(
        f"The inductance of {table.source} must fall with the distance, as that of a coil does whose iron moves away; "
        f"instead it goes from {near:.4g} mH at {1e3 * table.distance.min():.3g} mm to {far:.4g} mH at "
        f"{1e3 * table.distance.max():.3g} mm. If the column counts how far the plunger has entered, subtract it "
        "from its largest value."
    )


def _linear(law: ForceLaw, shape: Mapping[str, float], table: InductanceTable) -> tuple[FloatArray, FloatArray]:
    """(L_0 and a_k, none negative, and what is left of the flux linkages)."""
    phi = law.potential_columns(table.distance, shape)
    matrix = np.column_stack([np.ones(len(phi)), 2.0 * phi]) * table.current[:, None]
    scale = np.linalg.norm(matrix, axis=0)
    solution = non_negative(matrix / scale, table.inductance * table.current)[0] / scale
    return solution, matrix @ solution - table.inductance * table.current
