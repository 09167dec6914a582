"""How far a model is from the sweep, and from the co-energy reference."""

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.fit.rows import FitRows
from femfit.model.actuator_model import Misfit
from femfit.model.magnetics import Magnetics


def misfit_to_rows(magnetics: Magnetics, rows: FitRows, hall_rms_T: float | None = None) -> Misfit:
    """Model minus sweep.

    Parameters
    ----------
    hall_rms_T : float or None
        Misfit of the Hall characteristic, where there is one.
    """
    force = magnetics.force(rows.distance, rows.current)
    flux = None
    if rows.flux_linkage is not None:
        flux = _rms(magnetics.flux_linkage(rows.distance, rows.current) - rows.flux_linkage)
    return _misfit(force, rows.force, rows, flux, hall_rms_T, "sweep")


def misfit_between(magnetics: Magnetics, reference: Magnetics, rows: FitRows) -> Misfit:
    """Model minus co-energy reference, on the sweep's points."""
    d, i = rows.distance, rows.current
    flux = None
    if rows.flux_linkage is not None:
        flux = _rms(magnetics.flux_linkage(d, i) - reference.flux_linkage(d, i))
    return _misfit(magnetics.force(d, i), reference.force(d, i), rows, flux, None, "co-energy reference")


def _misfit(
    force: FloatArray, truth: FloatArray, rows: FitRows, flux: float | None, hall: float | None, against: str
) -> Misfit:
    error = force - truth
    return Misfit(
        force_rms_N=_rms(error),
        force_max_N=float(np.max(np.abs(error))),
        force_rms_relative=_rms(error / rows.force_scale),
        force_rms_of_weight=None if rows.hanging_weight is None else _rms(error) / rows.hanging_weight,
        flux_linkage_rms_Wb=flux,
        hall_rms_T=hall,
        rows=len(error),
        against=against,
    )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
