"""A probe scan beside the drawing: how far the solved field is from what was read, and what simple would explain it.

To first order a reading differs from the solved field B_z(r, z) by

    e B_z + b + dz (dB_z/dz) + dr (dB_z/dr):

a gain of the probe (or of all sources of the field), an offset, and a probe that stands beside the recorded place.
All four are fitted at once by least squares; one counts where twice its standard error does not reach zero.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from femfit.core.amount import amount, counted
from femfit.core.arrays import FloatArray
from femfit.core.errors import TableError
from femfit.core.printed import Printed
from femfit.device.parts import Actuator
from femfit.field.probe import axial_field
from femfit.identify.constants import LEAST_SCAN, SCAN_STEP_M
from femfit.identify.readings.place import notes
from femfit.tables.field_scan import FieldScan

_WORDS = {
    "gain": "the probe reads {size} too {much|little}, or the sources are {stronger|weaker} than drawn",
    "offset_T": "the probe reads {size} {more|less} everywhere",
    "higher_m": "the probe stands {size} {higher|lower} along z than recorded",
    "outer_m": "the probe stands {size} further {out|in} than recorded",
}


@dataclass(frozen=True, eq=False, repr=False)
class FieldScanComparison(Printed):
    """A probe scan beside the solved field; printed, it is what ``femfit compare`` prints.

    Parameters
    ----------
    predicted_T, residual_T : array, shape (n,)
        The solved axial field, and read minus solved.
    explained : dict of str to (float, float)
        Of ``gain``, ``offset_T``, ``higher_m`` and ``outer_m`` those that count, each with its standard error.
    left_T : float
        Root mean square that all four leave.
    """

    scan: FieldScan
    predicted_T: FloatArray
    residual_T: FloatArray
    explained: dict[str, tuple[float, float]]
    left_T: float

    @property
    def rms_T(self) -> float:  # noqa: N802  the unit
        """Root mean square of read minus solved."""
        return _rms(self.residual_T)

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        return {
            "readings": len(self.residual_T),
            "rms_T": self.rms_T,
            "left_T": self.left_T,
            "explained": {name: list(pair) for name, pair in self.explained.items()},
            "predicted_T": self.predicted_T.tolist(),
            "residual_T": self.residual_T.tolist(),
        }

    def __str__(self) -> str:
        scan, worst = self.scan, int(np.argmax(np.abs(self.residual_T)))
        where = (
            f"r = {amount(float(scan.radius[worst]), 'm')}, z = {amount(float(scan.height[worst]), 'm')}, distance "
            f"{amount(float(scan.distance[worst]), 'm')}, {amount(float(scan.current[worst]), 'A')}"
        )
        share = self.rms_T / (_rms(self.predicted_T) or 1.0)
        error = f"error {amount(self.rms_T, 'T')} rms in {counted(len(self.residual_T), 'reading')}"
        largest = f"largest {amount(float(self.residual_T[worst]), 'T')} at {where}"
        lines = [f"field: {error}, {amount(share, '')} of the solved field's rms; {largest}"]
        said = [_clause(name, *pair) for name, pair in self.explained.items()]
        if said:
            lines += [f"  {one}." for one in said]
            lines.append(f"Together {'they leave' if len(said) > 1 else 'it leaves'} {amount(self.left_T, 'T')} rms.")
        elif len(self.residual_T) >= LEAST_SCAN:
            lines.append("Neither a gain, an offset nor another place of the probe explains a part of it.")
        return "\n".join([*lines, *notes(scan.findings)])


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
    r, z = np.abs(scan.radius), scan.height
    inner = np.maximum(r - SCAN_STEP_M, 0.0)
    places = ((r, z), (r, z + SCAN_STEP_M), (r, z - SCAN_STEP_M), (r + SCAN_STEP_M, z), (inner, z))
    count = len(places)
    solved = axial_field(
        actuator,
        np.tile(scan.distance, count),
        np.tile(scan.current, count),
        np.concatenate([place[0] for place in places]),
        np.concatenate([place[1] for place in places]),
    ).reshape(count, -1)
    field = solved[0]
    along_z = (solved[1] - solved[2]) / (2.0 * SCAN_STEP_M)
    along_r = (solved[3] - solved[4]) / (r + SCAN_STEP_M - inner) * np.where(scan.radius < 0.0, -1.0, 1.0)
    residual = scan.field - field
    columns = {"gain": field, "offset_T": np.ones(len(field)), "higher_m": along_z, "outer_m": along_r}
    explained, left = _explained(columns, residual)
    return FieldScanComparison(scan, field, residual, explained, left)


def _explained(columns: dict[str, FloatArray], residual: FloatArray) -> tuple[dict[str, tuple[float, float]], float]:
    """The columns that count, with their standard errors, fitted again without the others; and what they leave."""
    names = [name for name, column in columns.items() if np.any(column != 0.0)] if len(residual) >= LEAST_SCAN else []
    while names:
        matrix = np.stack([columns[name] for name in names], axis=1)
        scale = np.linalg.norm(matrix, axis=0)
        left, sizes, right = np.linalg.svd(matrix / scale, full_matrices=False)
        keep = sizes > 1e-6 * sizes[0]
        value = (right[keep].T @ ((left[:, keep].T @ residual) / sizes[keep])) / scale
        rest = residual - matrix @ value
        sigma = np.sqrt(rest @ rest / max(len(rest) - len(names), 1))
        error = sigma * np.sqrt(np.sum((right[keep] / sizes[keep, None]) ** 2, axis=0)) / scale
        counts = np.abs(value) > 2.0 * error
        if counts.all():
            return {n: (float(v), float(e)) for n, v, e in zip(names, value, error, strict=True)}, _rms(rest)
        weakest = int(np.argmin(np.abs(value) / np.maximum(error, 1e-300)))
        names.pop(weakest)
    return {}, _rms(residual)


def _clause(name: str, value: float, error: float) -> str:
    """What a fitted value means, with the interval of two standard errors."""
    unit = name.rpartition("_")[2] if "_" in name else ""
    text = _WORDS[name].format_map(_Sized(amount(abs(value), unit), value))
    return f"{text} (95 %: ±{amount(2.0 * error, unit)})"


class _Sized(dict[str, str]):
    """Fills ``{size}`` and, by the sign, ``{more|less}``."""

    def __init__(self, size: str, value: float) -> None:
        super().__init__(size=size)
        self._positive = value > 0.0

    def __missing__(self, key: str) -> str:
        first, _, second = key.partition("|")
        return first if self._positive else second


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
