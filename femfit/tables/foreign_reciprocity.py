"""Whether force and flux linkage of a table belong to one co-energy.

The co-energy W'(d, i) is a state function: dW' = -F dd + lambda di. Around a rectangle d1..d2 x i1..i2 the circulation
vanishes, so that

    integral over d of F(d, i2) - F(d, i1)  =  integral over i of lambda(d1, i) - lambda(d2, i).

Integrals do not amplify noise as dF/di = -d(lambda)/dd would; an error of the force that is the same at every current
cancels, and so does a constant of the flux linkage.

References
----------
H. H. Woodson, J. R. Melcher, Electromechanical Dynamics, Part I, Wiley 1968, section 3.1 (conservative fields).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from femfit.core.numerics import FloatArray
from femfit.core.results import Finding
from femfit.tables.findings import finding
from femfit.tables.foreign_grid import complete_grid

_AGREES = 0.02
"""First-order field solutions keep reciprocity within 1 %; coarse grids add as much by integration."""

_WRONG = 0.10
"""No mesh does this: units, turns or another quantity."""

_SAME_SHAPE = 0.10
"""Spread of the factor over the loops below which the two sides have one shape."""

_NO_MAGNET = 0.01
"""Force at zero current over the largest force, up to which there is no magnet but numerical noise."""

_LARGE = 0.05  # rectangles whose work is below this share of the largest hold more noise than information

FluxOf = Callable[[FloatArray, FloatArray], FloatArray]


def _apparent(currents: FloatArray, column: FloatArray) -> FloatArray:
    """The flux linkage (Wb) of an apparent inductance, flux linkage / current, shape (n, m) in H."""
    return column * currents


def _differential(currents: FloatArray, column: FloatArray) -> FloatArray:
    """Integral of d(flux linkage)/di, shape (n, m) in H, from the first of ascending currents: flux linkage in Wb."""
    return np.asarray(CubicSpline(currents, column, axis=1).antiderivative()(currents))


@dataclass(frozen=True)
class _Loops:
    """Work of the force against that of the flux linkage over many rectangles."""

    factor: float  # Median of flux side / force side; 1 for a table that is reciprocal
    spread: float  # Robust relative spread of that ratio over the rectangles; large if the two have different shapes
    loops: int

    @property
    def within(self) -> str:
        return f"within {100 * self.spread:.2g} % over {self.loops} closed loops"


def check_reciprocity(points: pd.DataFrame) -> list[Finding]:
    """Compare the force's work with the flux linkage's.

    It is said where reciprocity holds or cannot be judged, a warning up to 10 %, an error beyond; nothing is said
    without a column of flux linkages.
    """
    if "flux_linkage_Wb" not in points:
        return []
    distances, currents, (force, flux) = complete_grid(points, ["force_N", "flux_linkage_Wb"])
    if len(distances) < 3 or len(currents) < 2:
        return [finding("reciprocity unchecked")]
    plain = _compare_loops(distances, currents, force, flux)
    if plain.loops == 0:
        return [finding("reciprocity still")]
    if plain.spread < _SAME_SHAPE:
        return [_judge_factor(plain)]
    for name, reading in (
        ("the flux linkage divided by the current (apparent inductance)", _apparent),
        ("the differential inductance d(flux linkage)/di", _differential),
    ):
        loops = _compare_reading(distances, currents, force, flux, reading)
        if loops.spread < min(_SAME_SHAPE, plain.spread / 3):
            scale = "" if abs(loops.factor - 1) < _WRONG else f", up to a factor {loops.factor:.4g}"
            facts = {"quantity": name, "scale": scale, "within": loops.within}
            return [finding("reciprocity inductance", size=loops.factor, **facts)]
    percent = 100 * plain.spread
    return [finding("reciprocity shape", size=plain.spread, factor=plain.factor, percent=percent, loops=plain.loops)]


def _judge_factor(loops: _Loops) -> Finding:
    error = abs(loops.factor - 1)
    if error < _WRONG:
        key = "reciprocity holds" if error < max(_AGREES, loops.spread) else "reciprocity rough"
        return finding(key, size=error, percent=100 * error, loops=loops.loops)
    return finding("reciprocity factor", size=loops.factor, within=loops.within)


def _compare_reading(
    distances: FloatArray, currents: FloatArray, force: FloatArray, column: FloatArray, reading: FluxOf
) -> _Loops:
    """Loops with a column read as inductance; its value at zero current, 0/0, is left out where that is possible."""
    keep = currents != 0 if reading is _apparent and (currents != 0).sum() > 1 else np.ones(len(currents), bool)
    return _compare_loops(distances, currents[keep], force[:, keep], reading(currents[keep], column[:, keep]))


def flux_from_inductance(points: pd.DataFrame) -> tuple[pd.DataFrame, list[Finding]]:
    """Take the flux linkage from an inductance column, only where reciprocity with the force proves it.

    lambda = L i lacks the magnet's flux linkage at zero current; only without a magnet, or with L = lambda / i at every
    current, the flux linkage follows, and then it must be reciprocal.
    """
    if "inductance_H" not in points or "flux_linkage_Wb" in points:
        return points, []
    distances, currents, (force, inductance) = complete_grid(points, ["force_N", "inductance_H"])
    if len(distances) < 3 or (currents != 0).sum() < 2:
        return points, [finding("inductance few")]
    loops = _compare_reading(distances, currents, force, inductance, _apparent)
    zero = (points["current_A"] == 0).to_numpy()
    passive = float(points.loc[zero, "force_N"].abs().max()) if zero.any() else 0.0
    if loops.spread > _SAME_SHAPE or abs(loops.factor - 1) > _AGREES + loops.spread:
        return points, [finding("inductance disagrees", size=loops.factor, percent=100 * loops.spread)]
    if passive > _NO_MAGNET * float(points["force_N"].abs().max()):
        return points, [finding("inductance magnet", size=loops.factor)]
    flux = np.where(zero, 0.0, points["inductance_H"].fillna(0.0) * points["current_A"])
    error = abs(loops.factor - 1)
    taken = finding("inductance", size=error, percent=100 * error, loops=loops.loops)
    return points.assign(flux_linkage_Wb=flux), [taken]


def _compare_loops(distances: FloatArray, currents: FloatArray, force: FloatArray, flux_linkage: FloatArray) -> _Loops:
    """Compare both sides over rectangles of a grid of n ascending distances (m) and m currents (A).

    Force (N) and flux linkage (Wb) have the shape (n, m). The factor is NaN where no rectangle holds any work.
    """
    # From the first level on; the work of any rectangle is a double difference of these.
    force_side = CubicSpline(distances, force, axis=0).antiderivative()(distances)
    flux_side = -CubicSpline(currents, flux_linkage, axis=1).antiderivative()(currents)
    force_works, flux_works = [], []
    for a, b in _blocks(len(distances)):
        for j, k in _blocks(len(currents)):
            force_works.append((force_side[b, k] - force_side[a, k]) - (force_side[b, j] - force_side[a, j]))
            flux_works.append((flux_side[b, k] - flux_side[b, j]) - (flux_side[a, k] - flux_side[a, j]))
    force_work, flux_work = np.array(force_works), np.array(flux_works)
    # The flux side decides which loops are large: a noisy force must not choose its own witnesses.
    keep = (np.abs(flux_work) >= _LARGE * np.abs(flux_work).max()) & (force_work != 0) & (flux_work != 0)
    if not keep.any():
        return _Loops(np.nan, np.inf, 0)
    ratios = flux_work[keep] / force_work[keep]
    factor = float(np.median(ratios))
    spread = float(np.median(np.abs(ratios - factor)) / 0.6745 / abs(factor)) if factor else np.inf
    return _Loops(factor, spread, int(keep.sum()))


def _blocks(count: int) -> list[tuple[int, int]]:
    """Index pairs of an axis: the whole, halves, quarters and eighths, without empty ones."""
    pairs: set[tuple[int, int]] = set()
    for parts in (1, 2, 4, 8):
        edges = np.unique(np.linspace(0, count - 1, parts + 1).round().astype(int))
        pairs.update(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
    return sorted(pairs)
