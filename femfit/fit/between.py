"""How far the co-energy of iron that saturates may be off between the points of its sweep, without solving any more.

A bend of the steel that is narrower than a step of the sweep leaves much open: splines of as many pieces, in other
coordinates of the distance and with their breaks in the current moved, meet the points alike and part between them. By
how much they part from the model is the estimate. It is the median over these splines for force and flux linkage; the
inductance is a broken line in the current for all of them, and what they share does not show, hence two thirds.

Calibrated on 29 grids, thinned out of sweeps of a conical solenoid, a holding magnet, a thin flange, two flat
solenoids, a relay and a valve: of what the points that were taken out are missed by (rms), the estimate is 0.27 to 3.2
for the force, 0.27 to 2.4 for the flux linkage and 0.31 to 6 for the inductance; within a factor of two on 21, 24 and
25 grids, of three on 26, 28 and 27. Points left out in turn give 0.1 to 2 for the force: they never leave out the least
distance, where it is missed most.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from femfit.core.amount import amount
from femfit.core.arrays import FloatArray
from femfit.fit.coenergy import CoenergyFit, gauged
from femfit.fit.coenergy_choice import distance_trials
from femfit.fit.coenergy_system import CoenergyBasis, coenergy_system
from femfit.fit.constants import COARSE, COARSE_INDUCTANCE, MOVED_BREAKS, PARTED
from femfit.fit.rows import FitRows, rms
from femfit.model.magnetics import CoenergySpline


@dataclass(frozen=True, eq=False)
class Between:
    """Estimated errors between the points, as parts of the rms over the table."""

    # Rms over the points halfway
    force: float
    flux_linkage: float
    inductance: float
    # The inductance's largest, and where
    largest: float
    distance_m: float
    current_A: float
    finer: dict[str, list[float]]  # The ``distance_m`` and ``current_A`` to add where it is missed most

    @property
    def poor(self) -> bool:
        """Whether the user is told to sweep more finely."""
        return self.force > COARSE or self.inductance > COARSE_INDUCTANCE

    def __str__(self) -> str:
        parts = ((self.force, "force"), (self.flux_linkage, "flux linkage"), (self.inductance, "inductance"))
        text = ", ".join(f"{name} {amount(share, '', 2)}" for share, name in parts)
        where = f"{1e3 * self.distance_m:.4g} mm and {self.current_A:.4g} A"
        return (
            f"between its points it may miss {text} (estimated rms); the inductance at most by "
            f"{amount(self.largest, '', 2)}, at {where}"
        )


def missed_between(fit: CoenergyFit, rows: FitRows) -> Between | None:
    """The estimate; None for a table without inductances, whose model is judged by points left out."""
    if rows.inductance is None or rows.flux_linkage is None:
        return None
    distance, current = halfway(rows)
    splines = fit.magnetics, *_others(fit.basis, rows)
    values = np.array([_quantities(spline, distance, current) for spline in splines])
    table = (rows.force, rows.flux_linkage, rows.inductance[np.isfinite(rows.inductance)])
    off = np.abs(values[1:] - values[0]) / np.array([[rms(column)] for column in table])
    parted = np.array([np.quantile(off[:, k], share, axis=0) for k, share in enumerate(PARTED)])
    force, flux_linkage, inductance = (rms(departure) for departure in parted)
    worst = int(np.argmax(parted[2]))
    chosen = parted[0] if force > COARSE else parted[2]
    most = 2.0 * chosen >= chosen.max()
    finer = {
        "distance_m": np.setdiff1d(distance[most], rows.distances).tolist(),
        "current_A": np.setdiff1d(current[most], rows.currents).tolist(),
    }
    place = float(distance[worst]), float(current[worst])
    return Between(force, flux_linkage, inductance, float(parted[2, worst]), *place, finer)


def halfway(rows: FitRows) -> tuple[FloatArray, FloatArray]:
    """Distances and currents in the middles of the grid's cells and of their sides, shape (n,) each."""
    axes = [np.sort(np.append(axis, 0.5 * (axis[1:] + axis[:-1]))) for axis in (rows.distances, rows.currents)]
    distance, current = (grid.ravel() for grid in np.meshgrid(*axes, indexing="ij"))
    new = ~(np.isin(distance, rows.distances) & np.isin(current, rows.currents))
    return distance[new], current[new]


def _quantities(magnetics: CoenergySpline, distance: FloatArray, current: FloatArray) -> list[FloatArray]:
    slope, flux, inductance = magnetics.coenergy_derivatives(distance, current, ((1, 0), (0, 1), (0, 2)))
    return [-slope, flux, inductance]


def _others(basis: CoenergyBasis, rows: FitRows) -> Iterator[CoenergySpline]:
    """The other splines: with each of the distance's trials the inner breaks in the current go up or down.

    They go without the shape constraints, which hold at the points and hardly act between them.
    """
    system, columns = coenergy_system(rows), np.array([rows.force, rows.flux_linkage, rows.inductance])[..., None]
    knots = basis.current_knots
    step = MOVED_BREAKS * np.diff(np.unique(knots)).min() * ((knots > knots[0]) & (knots < knots[-1]))
    alike = [replace(basis, **trial) for trial in distance_trials(rows)]
    for n, trial_basis in enumerate(trial_basis for trial_basis in alike if trial_basis.cells == basis.cells):
        moved = replace(trial_basis, current_knots=knots + (-1) ** (n + 1) * step)
        yield gauged(moved, system.without_constraints(moved, columns).reshape(moved.shape), rows)
