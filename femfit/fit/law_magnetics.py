"""A fitted law as the magnetics of a model, with the part of the circuit that its forces leave open."""

from dataclasses import replace

import numpy as np
from scipy.optimize import nnls

from femfit.fit.law_fit import LawFit
from femfit.fit.rows import FitRows
from femfit.model.magnetics import Coefficient, LawMagnetics


def law_magnetics(fit: LawFit, rows: FitRows, inductance_H: float | None = None) -> LawMagnetics:
    """The law with the coefficients of the fit to all rows, its inductance and flux linkage at the farthest point."""
    sides = fit.limits.active_sides(fit.joint)
    coefficients = []
    for n, (basis, power) in enumerate(fit.terms):
        unit = fit.law.coefficient_units[fit.law.basis.index(basis)]
        interval = fit.interval.block[n]
        coefficients.append(
            Coefficient(
                basis=basis,
                current_power=power,
                value=float(fit.joint.x[n]),
                unit=f"{unit} A^-{power}" if power else unit,
                ci95=None if sides[n] else (float(interval[0]), float(interval[1])),
                bounds=(float(fit.limits.lower[n]), float(fit.limits.upper[n])),
                active=sides[n],
            )
        )
    farthest = float(rows.distances[-1])
    law = LawMagnetics(
        fit.law.name, tuple(coefficients), dict(fit.shape), inductance_H or 0.0, reference_distance_m=farthest
    )
    if rows.flux_linkage is None:
        return law
    remaining = rows.flux_linkage - law.flux_linkage(rows.distance, rows.current)
    # Columns for an inductance >= 0 and a flux linkage of either sign.
    one, i = np.ones_like(rows.current), rows.current / (np.max(np.abs(rows.current)) or 1.0)
    inductance, plus, minus = nnls(np.stack([i, one, -one], axis=1), remaining)[0]
    return replace(
        law,
        constant_inductance_H=float(inductance / (np.max(np.abs(rows.current)) or 1.0)),
        constant_flux_linkage_Wb=float(plus - minus),
    )
