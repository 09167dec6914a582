"""The library of materials, and the curves of soft ones: H(B), its slope and the energy, from tabulated points.

Between the points H(B) is the monotone cubic of Fritsch and Carlson, so that dH/dB is continuous and H never turns
back; H is odd, which fixes its slope at B = 0. Beyond the last point dH/dB rises linearly to nu_0 over a fifth of the
last B and stays there: a saturated material takes up field like air. No slope exceeds nu_0. Points from users, a CSV
file or two lists, are checked before they are used.

References
----------
F. N. Fritsch and R. E. Carlson, SIAM J. Numer. Anal. 17 (1980) 238: monotone piecewise cubic interpolation;
C. Pechstein and B. Juettler, J. Comput. Appl. Math. 196 (2006) 45: monotone B-H curves in field solvers.
"""

import csv
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from femfit.core.errors import ActuatorFileError
from femfit.core.numerics import MU_0, FloatArray
from femfit.device.complaints import complain, meant_by, read_table
from femfit.device.keys import converted, keys_of
from femfit.device.parts import CURVE_KEYS, LinearMaterial, Material, NonlinearMaterial

TAIL = 0.2
"""Length, relative to the last B, over which dH/dB rises to nu_0. The polarisation still gained there is at most a
tenth of the last B, as between the usual end of a data sheet's curve (10 kA/m) and the saturation of iron."""


class BHCurve:
    """H(B), to be evaluated at arrays of B >= 0 in T."""

    def __init__(self, flux_density_T: tuple[float, ...], field_A_per_m: tuple[float, ...]) -> None:
        b, h = np.asarray(flux_density_T, dtype=np.float64), np.asarray(field_A_per_m, dtype=np.float64)
        slopes = np.minimum(_slopes(b, h), 1.0 / MU_0)
        tail = TAIL * b[-1]
        self.saturated_T = float(b[-1] + tail)
        saturated = float(h[-1] + 0.5 * tail * (slopes[-1] + 1.0 / MU_0))
        points = np.append(b, self.saturated_T), np.append(h, saturated), np.append(slopes, 1.0 / MU_0)
        curve = CubicHermiteSpline(*points)
        # From there on a straight line, and so beyond its end
        curve.extend(np.array([[0.0], [0.0], [1.0 / MU_0], [saturated]]), np.array([self.saturated_T + 1.0]))
        self._field, self._slope, self._energy = curve, curve.derivative(), curve.antiderivative()

    def field(self, b: FloatArray) -> FloatArray:
        """H in A/m."""
        return np.asarray(self._field(b))

    def differential_reluctivity(self, b: FloatArray) -> FloatArray:
        """dH/dB in m/H."""
        return np.asarray(self._slope(b))

    def reluctivity(self, b: FloatArray) -> FloatArray:
        """H / B in m/H, its limit dH/dB at B = 0."""
        b = np.asarray(b, dtype=np.float64)
        zero = b == 0.0
        return np.where(zero, float(self._slope(0.0)), self.field(b) / np.where(zero, 1.0, b))

    def energy_density(self, b: FloatArray) -> FloatArray:
        """Integral of H dB from 0, in J/m^3."""
        return np.asarray(self._energy(b))


def _slopes(b: FloatArray, h: FloatArray) -> FloatArray:
    """dH/dB at the points. With the points mirrored at B = 0, since H is odd, the slope there is the first secant's.

    At the last point it is at least the last secant's: a saturating curve does not become steeper in B(H) again.
    """
    mirrored = PchipInterpolator(np.append(-b[:0:-1], b), np.append(-h[:0:-1], h))
    slopes = np.asarray(mirrored(b, 1))
    slopes[-1] = max(slopes[-1], (h[-1] - h[-2]) / (b[-1] - b[-2]))
    return slopes


MIN_POINTS, MAX_POINTS = 3, 1000
MAX_FLUX_DENSITY = 5.0
"""In T; beyond what any magnet reaches, so that a larger value is one in kG, G or mT."""

MAX_RELATIVE_PERMEABILITY = 2e6
"""Above that of the softest alloys known (about 1e6, Supermalloy): a larger one is H in kA/m or Oe."""

SLOPE_TOLERANCE = 0.01
"""dB/dH may fall below mu_0 by so much: tables are rounded."""

LITTLE_BELOW = 0.5
"""Least dB/dH over mu_0 of a flux density that was measured a little too small in saturation; the polarisation, which
is often tabulated in its place, rises with less and less there."""

Points = tuple[tuple[float, ...], tuple[float, ...]]


def read_bh_csv(file: Path, path: str, problems: list[str]) -> Points | None:
    """Read B and H from a CSV file with the header ``B_T,H_A_per_m``; lines that begin with # are comments.

    None if it cannot be read, which is reported under a key path.
    """
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        code = "curve_absent" if isinstance(error, FileNotFoundError) else "curve_unreadable"
        complain(problems, code, path, file=file, error=error)
        return None
    rows = [(n, row) for n, row in enumerate(csv.reader(lines), 1) if row and not row[0].lstrip().startswith("#")]
    names = [name.strip() for name in rows[0][1]] if rows else []
    if not set(CURVE_KEYS) <= set(names):
        complain(problems, "curve_columns", path, columns=",".join(CURVE_KEYS), file=file, given=",".join(names)[:60])
        return None
    columns, values, wrong = [names.index(name) for name in CURVE_KEYS], list[list[float]](), list[str]()
    for number, row in rows[1:]:
        try:
            values.append([float(row[column]) for column in columns])
        except (ValueError, IndexError):
            complain(wrong, "curve_line", path, number=number, file=file, given=",".join(row)[:60])
    problems += wrong[:5]
    return None if wrong else (tuple(b for b, _ in values), tuple(h for _, h in values))


def without_flat_end(b: Sequence[float], h: Sequence[float], least: float = LITTLE_BELOW) -> tuple[Points, str]:
    """The curve without last points between which B rises less than mu_0 H, and a remark if there are any.

    Those are left in, to be refused, between which it rises by less than a ``least`` share of that.

    Published tables end so, where the field of the measuring coil was taken away a little too much. Above the last
    point that is kept the material takes up field like air, as it does above any curve's last point.
    """
    slopes = [
        (b1 - b0) / (h1 - h0) / MU_0 if h1 > h0 else 0.0 for (b0, h0), (b1, h1) in pairwise(zip(b, h, strict=True))
    ]
    length = len(b)
    while length > MIN_POINTS and least <= slopes[length - 2] < 1.0 - SLOPE_TOLERANCE:
        length -= 1
    points = tuple(b[:length]), tuple(h[:length])
    if length == len(b):
        return points, ""
    return points, (
        f"the B-H curve is cut at {b[length - 1]:g} T: above, it rises with less than mu_0 (down to "
        f"{min(slopes[length - 1 :]):.2g} mu_0), as no material does"
    )


def check_curve(b: Sequence[float], h: Sequence[float], path: str, problems: list[str]) -> None:
    """Report under a key path what is wrong with the points of a curve."""
    points = list(zip(b, h, strict=False))
    if len(b) != len(h):
        complain(problems, "curve_lengths", path, first=len(b), second=len(h))
    elif not MIN_POINTS <= len(b) <= MAX_POINTS:
        complain(problems, "curve_points", path, least=MIN_POINTS, most=MAX_POINTS, count=len(b))
    elif not all(abs(value) < 1e12 for value in (*b, *h)):  # false for NaN, too
        complain(problems, "curve_numbers", path)
    elif points[0] != (0.0, 0.0):
        complain(problems, "curve_start", path, b=b[0], h=h[0])
    elif any(after <= before for values in (b, h) for before, after in pairwise(values)):
        for name, values in zip(CURVE_KEYS, (b, h), strict=True):
            falls = [f"{after:g} after {before:g}" for before, after in pairwise(values) if after <= before]
            if falls:
                complain(problems, "curve_falls", path, name=name, places="; ".join(falls[:3]))
    else:
        if b[-1] > MAX_FLUX_DENSITY:
            complain(problems, "curve_tesla", path, most=MAX_FLUX_DENSITY, last=b[-1])
        steepest = max(right / field for right, field in points[1:]) / MU_0
        if steepest > MAX_RELATIVE_PERMEABILITY:
            complain(problems, "curve_steep", path, steepest=steepest)
        rises = ((b0, b1, (b1 - b0) / (h1 - h0) / MU_0) for (b0, h0), (b1, h1) in pairwise(points))
        start, end, slope = next((rise for rise in rises if rise[2] < 1.0 - SLOPE_TOLERANCE), (0.0, 0.0, 1.0))
        if start < end:
            complain(problems, "curve_flat", path, start=start, end=end, slope=slope)


KINDS = (LinearMaterial, NonlinearMaterial)


@dataclass(frozen=True)
class LibraryMaterial:
    """A material with its source."""

    material: Material
    reference: str  # Where the values come from, and what they leave out

    @property
    def table(self) -> dict[str, Any]:
        """The material as an actuator file would write it."""
        values = vars(self.material) | vars(self.material.thermal)
        keys = keys_of(type(self.material)).items()
        written = {name: converted(values.get(key.field), -key.power) for name, key in keys}
        stated = ((name, value) for name, value in written.items() if value is not None)
        return {name: list(value) if isinstance(value, tuple) else value for name, value in stated}


def _library() -> dict[str, LibraryMaterial]:
    """The entries of ``materials.toml``; the curves stand in the folder beside it, whose files repeat the source."""
    tables = tomllib.loads((files("femfit.device") / "materials.toml").read_text(encoding="utf-8"))
    library, problems = {}, list[str]()
    for name, values in tables.items():
        table = tables.get(values.pop("like", ""), {}) | values
        reference, curve = table.pop("reference"), table.pop("bh_curve", None)
        points = None if curve is None else read_bh_csv(Path(__file__).parent / curve, name, problems)
        table |= {} if points is None else dict(zip(CURVE_KEYS, map(list, points), strict=True))
        library[name] = LibraryMaterial(read_table(meant_by(table, KINDS), table, name, problems, name=name), reference)
    if problems:
        raise ActuatorFileError("materials.toml", problems)
    return library


LIBRARY: dict[str, LibraryMaterial] = _library()
"""By name, as written in actuator files."""
