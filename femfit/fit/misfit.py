"""How far a model is from its table: that of the file as it is read back, not that of the fit."""

import json

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.fit.rows import FitRows, rms
from femfit.model.actuator_model import ActuatorModel, Misfit
from femfit.model.from_json import model_from_dict
from femfit.model.magnetics import Magnetics
from femfit.model.to_json import model_to_dict


def as_written(model: ActuatorModel) -> ActuatorModel:
    """The model as its file holds it, read back."""
    return model_from_dict(json.loads(json.dumps(model_to_dict(model))))


def misfit_to_rows(model: ActuatorModel | Magnetics, rows: FitRows) -> Misfit:
    """Model minus table in force, flux linkage, inductance and, with a sensor, the field at the Hall element."""
    sensor = model.sensor if isinstance(model, ActuatorModel) else None
    magnetics = model.magnetics if isinstance(model, ActuatorModel) else model
    d, i = rows.distance, rows.current
    error = magnetics.force(d, i) - rows.force
    flux_rms = flux_share = inductance_rms = inductance_share = hall_rms = None
    if rows.flux_linkage is not None:
        flux = magnetics.flux_linkage(d, i)
        flux_rms = rms(flux - rows.flux_linkage)
        flux_share = _share(flux_rms, rows.flux_linkage)
        table, own = chord_inductance(rows, rows.flux_linkage), chord_inductance(rows, flux)
        if len(table):
            inductance_rms = rms(own - table)
            inductance_share = _share(inductance_rms, table)
    if sensor is not None and rows.hall is not None:
        hall_rms = rms(sensor.field.field(d, i) - rows.hall)
    return Misfit(
        force_rms_N=rms(error),
        force_max_N=float(np.max(np.abs(error))),
        force_rms_relative=rms(error / rows.force_scale),
        force_rms_of_weight=None if rows.hanging_weight is None else rms(error) / rows.hanging_weight,
        flux_linkage_rms_Wb=flux_rms,
        hall_rms_T=hall_rms,
        rows=len(error),
        against="sweep",
        inductance_rms_H=inductance_rms,
        force_share=_share(rms(error), rows.force),
        flux_linkage_share=flux_share,
        inductance_share=inductance_share,
    )


def chord_inductance(rows: FitRows, flux_linkage: FloatArray) -> FloatArray:
    """Change of flux linkage over that of current, from each current to the next at the same distance."""
    order = np.lexsort((rows.current, rows.distance))
    same = np.diff(rows.distance[order]) == 0.0
    return np.asarray((np.diff(flux_linkage[order])[same]) / (np.diff(rows.current[order])[same]))


def _share(error: float, values: FloatArray) -> float | None:
    size = rms(values)
    return error / size if size > 0.0 else None
