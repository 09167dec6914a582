"""A model from measured inductances: an attracting law whose forces are what the inductance's slope makes them.

Iron that does not saturate has W'(d, i) = L(d) i^2 / 2, so that L(d) = L_0 + 2 sum_k a_k Phi_k(d) gives the force
i^2 sum_k a_k phi_k(d) without any force having been measured. With a_k >= 0 the inductance falls with the distance and
the force attracts, as with every piece of soft iron.

References
----------
H. H. Woodson and J. R. Melcher, Electromechanical Dynamics, part I (Wiley, 1968), section 3.1.
G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413 (variable projection).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np
from scipy.optimize import least_squares, nnls

from femfit.core.arrays import FloatArray
from femfit.core.errors import FitError
from femfit.laws.catalogue import law_by_name
from femfit.laws.law import ForceLaw
from femfit.model.actuator_model import ActuatorModel, Circuit, Motion, ValidityBox
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.tables.inductance_table import InductanceTable


@dataclass(frozen=True)
class InductanceOptions:
    """What is known besides the inductances.

    Parameters
    ----------
    supply_V : (float, float) or None
        The driver's lowest and highest voltage, for the circuit.
    """

    law: str = "two-exponentials"
    mass_kg: float | None = None
    resistance_ohm: float | None = None
    supply_V: tuple[float, float] | None = None
    sample_time_s: float = 1e-3


@dataclass(frozen=True, eq=False)
class InductanceFit:
    """A model and how far it is from the inductances.

    Parameters
    ----------
    model : ActuatorModel
        To write with :func:`femfit.model.json_file.write_model`.
    rms_H, max_H : float
        Root mean square and largest of model minus table.
    notes : tuple of str
        What the model lacks, and how to give it.
    of_data : tuple of str
        What was left out of the table or converted.
    """

    model: ActuatorModel
    rms_H: float
    max_H: float
    rows: int
    notes: tuple[str, ...]
    of_data: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data, without the model."""
        return {"rows": self.rows, "rms_H": self.rms_H, "max_H": self.max_H, "notes": [*self.of_data, *self.notes]}


def fit_inductance(table: InductanceTable, options: InductanceOptions | None = None) -> InductanceFit:
    """Fit a force law to measured inductances.

    Parameters
    ----------
    table : InductanceTable
        Apparent inductances, weighted as flux linkages: a small current tells its inductance badly.

    Returns
    -------
    InductanceFit
        Force and flux linkage agree with each other whatever the table says of either.

    Raises
    ------
    FitError
        If there are fewer distances than the law has numbers, or its shape is not found.
    """
    options = options or InductanceOptions()
    law = law_by_name(options.law)
    distances = np.unique(table.distance)
    numbers = 1 + len(law.basis) + len(law.shape)
    if len(distances) < numbers:
        raise FitError(
            f"Law {law.name} has {numbers} numbers and needs as many distances; {table.source} has {len(distances)}. "
            "Measure at more distances, or take a simpler law."
        )
    shape = _shape(law, table)
    solution, _ = _linear(law, shape, table)
    coefficients = tuple(
        Coefficient(basis, 2, float(value), f"{unit} A^-2", bounds=(0.0, np.inf), active="" if value > 0.0 else "lower")
        for basis, unit, value in zip(law.basis, law.coefficient_units, solution[1:], strict=True)
    )
    magnetics = LawMagnetics(law.name, coefficients, shape, constant_inductance_H=float(solution[0]))
    away = magnetics.inductance(table.distance, table.current) - table.inductance
    circuit, motion, notes = _parts(options)
    model = ActuatorModel(
        name=table.source.rpartition(".")[0] or table.source,
        magnetics=magnetics,
        validity=ValidityBox(
            float(distances[0]), float(distances[-1]), min(0.0, float(table.current.min())), float(table.current.max())
        ),
        circuit=circuit,
        motion=motion,
        sample_time_s=options.sample_time_s,
        provenance={
            "fit": {"inductances": table.source, "rows": len(away), "law": law.name},
            "versions": {"femfit": version("femfit")},
        },
    )
    return InductanceFit(
        model, float(np.sqrt(np.mean(away**2))), float(np.abs(away).max()), len(away), notes, table.findings
    )


def inductance_lines(fit: InductanceFit) -> list[str]:
    """What ``femfit fit`` prints."""
    model, magnetics = fit.model, fit.model.magnetics
    box = model.validity
    at = np.array([box.distance_min_m, box.distance_max_m])
    first, last = magnetics.inductance(at, np.ones(2))
    pull = magnetics.force(at, np.full(2, box.current_max_A))
    return [
        *(f"note: {note}" for note in fit.of_data),
        f"{model.name}: {fit.rows} inductances, no force; the law's force is what their slope makes it",
        f"inductance {1e3 * first:.4g} mH at {1e3 * at[0]:.3g} mm to {1e3 * last:.4g} mH at {1e3 * at[1]:.3g} mm",
        f"misfit of the inductance {1e3 * fit.rms_H:.2g} mH rms, at most {1e3 * fit.max_H:.2g} mH",
        f"force at {box.current_max_A:.3g} A: {pull[0]:.3g} to {pull[1]:.3g} N",
        *(f"note: {note}" for note in fit.notes),
    ]


def _linear(law: ForceLaw, shape: Mapping[str, float], table: InductanceTable) -> tuple[FloatArray, FloatArray]:
    """(L_0 and a_k, none negative, and what is left of the flux linkages)."""
    phi = law.potential_columns(table.distance, shape)
    matrix = np.column_stack([np.ones(len(phi)), 2.0 * phi]) * table.current[:, None]
    scale = np.linalg.norm(matrix, axis=0)
    solution = nnls(matrix / scale, table.inductance * table.current)[0] / scale
    return solution, matrix @ solution - table.inductance * table.current


def _shape(law: ForceLaw, table: InductanceTable) -> dict[str, float]:
    """The law's nonlinear parameters; from three starts, the best."""
    if not law.shape:
        return {}
    names = [p.name for p in law.shape]
    lower, upper = np.array([p.lower for p in law.shape]), np.array([p.upper for p in law.shape])
    scale = float(np.max(np.abs(table.inductance * table.current)))

    def named(unit: FloatArray) -> dict[str, float]:
        return {name: float(v) for name, v in zip(names, lower * (upper / lower) ** unit, strict=True)}

    def misfit(unit: FloatArray) -> FloatArray:
        return _linear(law, named(unit), table)[1] / scale

    start = np.log(np.array([p.start for p in law.shape]) / lower) / np.log(upper / lower)
    guesses = (np.clip(start + step, 1e-3, 1.0 - 1e-3) for step in (0.0, -0.1, 0.1))
    found = [least_squares(misfit, guess, bounds=(0.0, 1.0), x_scale=0.1) for guess in guesses]
    best = min(found, key=lambda r: float(r.cost))
    if not best.success:
        raise FitError(f"The shape of law {law.name} was not found: {best.message} Try another law.")
    return named(best.x)


def _parts(options: InductanceOptions) -> tuple[Circuit | None, Motion | None, tuple[str, ...]]:
    circuit, motion, notes = None, None, []
    if options.resistance_ohm is not None and options.supply_V is not None:
        circuit = Circuit(options.resistance_ohm, *options.supply_V)
    else:
        notes.append("No circuit in the model: give --resistance-ohm and --supply-V LOW:HIGH.")
    if options.mass_kg is not None:
        motion = Motion(options.mass_kg)
    else:
        notes.append("No motion in the model: give --mass-g.")
    return circuit, motion, tuple(notes)
