"""Laws of soft iron: one whose force follows from measured inductances, and that of a plunger that saturates.

Iron that does not saturate has W'(d, i) = L(d) i^2 / 2, so that L(d) = L_0 + 2 sum_k a_k Phi_k(d) gives the force
i^2 sum_k a_k phi_k(d) without any force having been measured. With a_k >= 0 the inductance falls with the distance and
the force attracts, as with every piece of soft iron.

The plunger's network is fitted to force and flux linkage: least squares over its ten numbers.

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 3.1.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from casadi import SX
from scipy.optimize import least_squares

from femfit.core.errors import FitError
from femfit.core.graph import Expression, GraphFunction, building
from femfit.core.numerics import BoolArray, FloatArray
from femfit.core.results import Result
from femfit.core.text import amount, counted
from femfit.fit import constants
from femfit.fit.bounded_qp import non_negative
from femfit.fit.law_fit import search_shape
from femfit.fit.model_parts import actuator_entry, circuits_of, mechanics_of, sample_time
from femfit.fit.ranking import as_written, ranking_folds
from femfit.fit.rows import FitRows, rms
from femfit.fit.words import note, printed
from femfit.laws.catalogue import law_by_name
from femfit.laws.law import ForceLaw
from femfit.model.actuator_model import ActuatorModel
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.model.several_magnetics import NETWORK, NetworkMagnetics
from femfit.model.validity import ValidityBox
from femfit.tables.measurement import InductanceTable


@dataclass(frozen=True, eq=False, repr=False)
class InductanceFit(Result):
    """A model and how far it is from the inductances."""

    model: ActuatorModel
    # Root mean square and largest of model minus table
    rms_H: float
    max_H: float
    rows: int
    notes: tuple[str, ...]  # What the model lacks, and how to give it
    of_data: tuple[str, ...] = ()  # What was left out of the table or converted

    @property
    def data(self) -> dict[str, Any]:
        """What programs read, without the model."""
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
    entry = actuator_entry(None, actuator, mass_kg, resistance_ohm, supply_V)
    chosen = law_by_name(law)
    distances = np.unique(table.distance)
    numbers = 1 + len(chosen.basis) + len(chosen.shape)
    if len(distances) < numbers:
        raise FitError(
            f"Law {chosen.name} has {counted(numbers, 'number')} and needs as many distances; {table.source} has "
            f"{len(distances)}. Measure at more distances, or take a simpler law."
        )
    scale = float(np.max(np.abs(table.inductance * table.current)))
    shape = search_shape(chosen, lambda trial: _linear(chosen, trial, table)[1] / scale)
    solution, _ = _linear(chosen, shape, table)
    coefficients = tuple(
        Coefficient(basis, 2, float(value), f"{unit} A^-2", bounds=(0.0, np.inf), active="" if value > 0.0 else "lower")
        for basis, unit, value in zip(chosen.basis, chosen.coefficient_units, solution[1:], strict=True)
    )
    magnetics = LawMagnetics(chosen.name, coefficients, shape, constant_inductance_H=float(solution[0]))
    (circuits, notes), motion = circuits_of(entry), mechanics_of(entry)
    notes = notes if motion else (*notes, note("no_motion"))
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
    if rms(error) > constants.POOR_CIRCUIT * float(np.ptp(table.inductance)):
        notes = (*notes, note("inductance_misfit", rms(error) / float(np.ptp(table.inductance))))
    findings = tuple(map(str, table.findings))
    return InductanceFit(model, rms(error), float(np.abs(error).max()), len(error), notes, findings)


def _linear(law: ForceLaw, shape: Mapping[str, float], table: InductanceTable) -> tuple[FloatArray, FloatArray]:
    """(L_0 and a_k, none negative, and what is left of the flux linkages)."""
    phi = law.potential_columns(table.distance, shape)
    matrix = np.column_stack([np.ones(len(phi)), 2.0 * phi]) * table.current[:, None]
    scale = np.linalg.norm(matrix, axis=0)
    solution = non_negative(matrix / scale, table.inductance * table.current)[0] / scale
    return solution, matrix @ solution - table.inductance * table.current


@dataclass(frozen=True, eq=False)
class NetworkFit:
    """A fitted network."""

    magnetics: NetworkMagnetics
    # Rms error of the force over its rms: on all rows, and on blocks of distances and single currents left out
    fitted: float
    left_out: float


def fit_network(rows: FitRows) -> NetworkFit:
    """Fit the network.

    Raises
    ------
    FitError
        If the table has no flux linkage, too few settings, or a force without current, which the law cannot have; or if
        no start comes to a minimum.
    """
    _require_plunger(rows)
    readings = _readings(rows)
    numbers = _best(readings, rows, np.ones(len(rows.force), dtype=np.bool_), _starts(rows))
    magnetics = _magnetics(numbers.tolist(), rows)
    errors = []
    for out in ranking_folds(rows):
        refit = _magnetics(_best(readings, rows, ~out, [numbers]).tolist(), rows)
        errors.append(refit.force(rows.distance[out], rows.current[out, None]) - rows.force[out])
    fitted = rms(magnetics.force(rows.distance, rows.current[:, None]) - rows.force) / rms(rows.force)
    left_out = rms(np.concatenate(errors)) / rms(rows.force) if errors else np.inf
    return NetworkFit(magnetics, fitted, max(fitted, left_out))


def _require_plunger(rows: FitRows) -> None:
    if rows.flux_linkage is None:
        raise FitError(
            f"Law {NETWORK} must have flux_linkage_Wb beside the force, to tell the iron from the gap; the table has "
            "none. Sweep or import it, or take another law."
        )
    currents = np.unique(np.abs(rows.current[rows.current != 0.0]))
    if len(currents) < constants.NETWORK_CURRENTS or len(rows.distances) < constants.NETWORK_DISTANCES:
        raise FitError(
            f"Law {NETWORK} must have at least {constants.NETWORK_CURRENTS} currents beside zero and "
            f"{constants.NETWORK_DISTANCES} distances; instead received {len(currents)} and {len(rows.distances)}. "
            "Sweep more."
        )
    idle = np.abs(rows.force[rows.current == 0.0])
    if np.max(idle, initial=0.0) > constants.NETWORK_IDLE * rms(rows.force):
        raise FitError(
            f"Law {NETWORK} is of plungers without a magnet; the table has {amount(float(idle.max()), 'N', 3)} without "
            "current. Take another law, or the co-energy."
        )


def _starts(rows: FitRows) -> list[FloatArray]:
    """Numbers of a gap whose reluctance grows with a power of the distance, and of iron a little above the largest."""
    flux = rows.linked[:, 0]
    carries = rows.current != 0.0
    inductance = float(np.median(flux[carries] / rows.current[carries]))
    largest, current = float(np.max(np.abs(flux))), float(np.max(np.abs(rows.current)))
    return [
        np.array(
            [np.log(a), -np.log(inductance), 0.6, 0, 0, 1.3 * largest, 0, np.log(c * current), 0.05 * inductance, 0]
        )
        for a, c in constants.NETWORK_STARTS
    ]


def _magnetics(numbers: Expression, rows: FitRows) -> NetworkMagnetics:
    """The law of numbers, or of an expression's."""
    a, r0, r1, r2, r3, s0, s1, c, l0, l1 = (numbers[k] for k in range(constants.NETWORK_NUMBERS))
    reference = float(np.median(rows.distances - min(rows.distances[0], 0.0)))
    shift = reference * np.exp(a) - min(float(rows.distances[0]), 0.0)
    return NetworkMagnetics(reference, shift, (r0, r1, r2, r3), (s0, s1), np.exp(c), (l0, l1))


def _readings(rows: FitRows) -> GraphFunction:
    """Of points (2, n) and numbers: force and flux linkage, and after them their slopes along each number."""
    with building():
        at, numbers = SX.sym("at", 2), SX.sym("numbers", constants.NETWORK_NUMBERS)
        coenergy = _magnetics(numbers, rows).expression(at[0], at[1])
        seen = ca.vertcat(-ca.gradient(coenergy, at[0]), ca.gradient(coenergy, at[1]))
        return GraphFunction([at, numbers], ca.vertcat(seen, ca.vec(ca.jacobian(seen, numbers))))


def _best(readings: GraphFunction, rows: FitRows, fitted: BoolArray, starts: list[FloatArray]) -> FloatArray:
    """The numbers with the least sum of squares on the rows kept, from several starts; scaled to order one."""
    first = starts[0]
    unit = np.array([1.0] * 5 + [abs(first[5])] * 2 + [1.0] + [float(np.exp(-first[1]))] * 2)
    points = np.stack([rows.distance, rows.current])[:, fitted]
    measured = np.concatenate([rows.force[fitted], rows.linked[fitted, 0]])
    size = np.repeat([rms(rows.force), rms(rows.linked)], points.shape[1])

    def unbounded(values: FloatArray) -> FloatArray:
        return np.nan_to_num((values[:2].ravel() - measured) / size, nan=constants.NETWORK_OFF)

    def errors(x: FloatArray) -> FloatArray:
        return unbounded(readings(points, x * unit)).clip(-constants.NETWORK_OFF, constants.NETWORK_OFF)

    def slopes(x: FloatArray) -> FloatArray:
        values = readings(points, x * unit)
        along = np.nan_to_num(
            values[2:].reshape(constants.NETWORK_NUMBERS, -1).T / size[:, None], posinf=0.0, neginf=0.0
        )
        return np.where(np.abs(unbounded(values))[:, None] < constants.NETWORK_OFF, along * unit, 0.0)

    minima = [least_squares(errors, start / unit, slopes, max_nfev=300) for start in starts]
    best = min(minima, key=lambda minimum: float(minimum.cost))
    if not np.isfinite(best.cost) or best.cost >= constants.NETWORK_OFF:
        raise FitError(f"Law {NETWORK} comes to no minimum on this table. Take another law, or the co-energy.")
    return np.asarray(best.x * unit)
