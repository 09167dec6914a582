"""A probe scan beside the drawing: how far the solved field is from what was read, and what simple would explain it.

Where the field is B_z(r, z), a probe at a recorded place reads

    (1 + e) B_z(r + dr, z + dz) + b:

a gain of the probe (or of all sources of the field), an offset, and a probe that stands beside the recorded place.
All four are fitted at once by least squares. One counts where twice its standard error does not reach zero. A fit that
leads out of the solved field has no minimum within it and tells nothing.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import optimize

from femfit.core.errors import DomainError, TableError
from femfit.core.numerics import FloatArray
from femfit.core.text import counted
from femfit.device.parts import Actuator
from femfit.field.problem import AxialField, axial_field
from femfit.identify.constants import LEAST_SCAN, SCAN_STEP_M, SCAN_STEPS
from femfit.identify.words import Result, printed
from femfit.tables.measurement import FieldScan

FitEnd = Literal["settled", "edge", "steps"]
"""How a fit ended: by steps far below the standard errors, at the edge of the solved field, or after too many steps."""

_SCALES = {"gain": 0.1, "offset_T": 0.01, "higher_m": 1e-3, "outer_m": 1e-3}
"""What is fitted to a scan, and its usual size."""


@dataclass(frozen=True, eq=False, repr=False)
class FieldScanComparison(Result):
    """A probe scan beside the solved field; printed, it is what ``femfit compare`` prints.

    Parameters
    ----------
    predicted_T, residual_T : array, shape (n,)
        The solved axial field, and read minus solved.
    explained : dict of str to (float, float)
        Of ``gain``, ``offset_T``, ``higher_m`` and ``outer_m`` those that count, each with its standard error.
    left_T : float
        Root mean square that those leave: ``rms_T`` where none counts.
    fit_end : {"settled", "edge", "steps"}
        How the fit ended; where it did not settle, ``explained`` is empty.
    """

    data = ("readings", "rms_T", "left_T", "fit_end", "explained", "predicted_T", "residual_T")

    scan: FieldScan
    predicted_T: FloatArray
    residual_T: FloatArray
    explained: dict[str, tuple[float, float]]
    left_T: float
    fit_end: FitEnd = "settled"

    @property
    def rms_T(self) -> float:  # noqa: N802  the unit
        """Root mean square of read minus solved."""
        return _rms(self.residual_T)

    @property
    def readings(self) -> int:
        """How many there are."""
        return len(self.residual_T)

    def __str__(self) -> str:
        scan, worst = self.scan, int(np.argmax(np.abs(self.residual_T)))
        place = {name: float(getattr(scan, name)[worst]) for name in ("radius", "height", "distance", "current")}
        share, largest = self.rms_T / (_rms(self.predicted_T) or 1.0), float(self.residual_T[worst])
        enough, steps = len(self.residual_T) >= LEAST_SCAN, SCAN_STEPS
        return printed("field_scan", r=self, place=place, share=share, largest=largest, enough=enough, steps=steps)


def compare_field_scan(actuator: Actuator, scan: FieldScan) -> FieldScanComparison:
    """Solve the drawing's field at the places of a probe scan and compare.

    Raises
    ------
    TableError
        If currents are recorded for a drawing without a circuit, or it has several circuits.
    DomainError
        If a place lies outside of the solved domain.
    """
    if len(actuator.circuits) > 1 or (not actuator.circuits and np.any(scan.current != 0.0)):
        raise TableError(
            f"{scan.source} has one current, and {actuator.name!r} has {counted(len(actuator.circuits), 'circuit')}. "
            "Compare a drawing with one circuit, or leave the current out where it has none."
        )
    solved = axial_field(actuator, scan.distance, scan.current)
    predicted = solved(scan.radius, scan.height)
    residual = scan.field - predicted
    if len(residual) < LEAST_SCAN:
        return FieldScanComparison(scan, predicted, residual, {}, _rms(residual))
    return FieldScanComparison(scan, predicted, residual, *_explained(scan, solved))


def _explained(scan: FieldScan, solved: AxialField) -> tuple[dict[str, tuple[float, float]], float, FitEnd]:
    """What counts, with its standard error, fitted again without the others; the rms that it leaves; the fit's end."""
    value = dict.fromkeys(_SCALES, 0.0)
    end: FitEnd = "settled"
    misfit = _rms(scan.field - solved(scan.radius, scan.height))
    while value:
        value, error, rms, last = _fitted(scan, solved, value)
        if all(abs(value[name]) > 2.0 * error[name] for name in value):
            if last != "settled":
                return {}, misfit, last
            return {name: (value[name], error[name]) for name in value}, rms, last
        end = last if last != "settled" else end
        del value[min(value, key=lambda name: abs(value[name]) / max(error[name], 1e-300))]
    return {}, misfit, end


def _fitted(
    scan: FieldScan, solved: AxialField, start: dict[str, float]
) -> tuple[dict[str, float], dict[str, float], float, FitEnd]:
    """Values and standard errors by least squares, the rms that they leave, and how the fit ended.

    Where a step puts the probe where no field is solved nothing is fitted, so that the next one is shorter.
    """
    names, scale = list(start), np.array([_SCALES[name] for name in start])
    outside = scan.field + float(np.abs(scan.field).max())

    def residual(x: FloatArray) -> FloatArray:
        value = dict(zip(names, x * scale, strict=True))
        r, z = scan.radius + value.get("outer_m", 0.0), scan.height + value.get("higher_m", 0.0)
        try:
            field = solved(r, z)
        except DomainError:
            return outside
        return scan.field - (1.0 + value.get("gain", 0.0)) * field - value.get("offset_T", 0.0)

    x = np.array(list(start.values())) / scale
    fit = optimize.least_squares(residual, x, "3-point", diff_step=np.array([1e-2]), x_scale="jac", max_nfev=SCAN_STEPS)
    beyond = [sign * 2.0 * SCAN_STEP_M * (np.array(names) == name) for name in names for sign in (1.0, -1.0)]
    edge = any(residual(fit.x + step / scale) is outside for step in beyond)
    freedom = max(len(fit.fun) - len(names), 1)
    slopes = np.asarray(fit.jac)
    covariance = np.linalg.pinv(slopes.T @ slopes, rcond=1e-12, hermitian=True)
    error = scale * np.sqrt(fit.fun @ fit.fun / freedom * np.diag(covariance))
    values, errors = (dict(zip(names, row.tolist(), strict=True)) for row in (fit.x * scale, error))
    return values, errors, _rms(fit.fun), "edge" if edge else "settled" if fit.status > 0 else "steps"


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
