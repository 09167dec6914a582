"""The model as JSON-ready data, without loss."""

import math
from dataclasses import asdict
from typing import Any

from femfit.core.errors import ModelFileError
from femfit.effects.effect import AddedEffect
from femfit.model.actuator_model import ActuatorModel
from femfit.model.hall import HallField, HallSpline
from femfit.model.magnetics import Coefficient, CoenergySpline, LawMagnetics, Magnetics

SCHEMA_VERSION = 1


def model_to_dict(model: ActuatorModel) -> dict[str, Any]:
    """The model as JSON-ready data."""
    base, sensor = model.without_effects, None
    if base.sensor is not None:
        sensor = {key: value for key, value in vars(base.sensor).items() if key != "field"}
        sensor["field"] = _field_to_dict(base.sensor.field)
    return {
        "schema": SCHEMA_VERSION,
        "name": model.name,
        "magnetics": _magnetics_to_dict(base.magnetics),
        "validity": asdict(model.validity),
        "circuit": asdict(base.circuit) if base.circuit else None,
        "motion": asdict(base.motion) if base.motion else None,
        "sensor": sensor,
        "misfit": asdict(model.misfit) if model.misfit else None,
        "sample_time_s": model.sample_time_s,
        "reference_distances_m": list(model.reference_distances_m),
        "covariance": None if model.covariance is None else model.covariance.tolist(),
        "effects": [_effect_to_dict(added) for added in model.effects],
        "coil_temperature_C": model.coil_temperature_C,
        "magnet_temperature_C": model.magnet_temperature_C,
        "kind": asdict(base.kind) if base.kind else None,
        "provenance": dict(model.provenance),
    }


def _effect_to_dict(added: AddedEffect) -> dict[str, Any]:
    return {
        "name": added.effect.name,
        "parameters": dict(added.parameters),
        "ci95": {name: list(interval) for name, interval in added.ci95.items()},
    }


def _field_to_dict(field: HallField) -> dict[str, Any]:
    if isinstance(field, HallSpline):
        return _spline_to_dict(field)
    raise ModelFileError(f"The field at the Hall element must be a spline to be written; it is {type(field).__name__}.")


def _magnetics_to_dict(magnetics: Magnetics) -> dict[str, Any]:
    if isinstance(magnetics, CoenergySpline):
        return {
            "kind": "coenergy_spline",
            **_spline_to_dict(magnetics),
        }
    if isinstance(magnetics, LawMagnetics):
        return {
            "kind": "law",
            "law": magnetics.law_name,
            "shape": dict(magnetics.shape),
            "coefficients": [_coefficient_to_dict(c) for c in magnetics.coefficients],
            "constant_inductance_H": magnetics.constant_inductance_H,
            "constant_flux_linkage_Wb": magnetics.constant_flux_linkage_Wb,
            "reference_distance_m": magnetics.reference_distance_m,
        }
    raise ModelFileError(
        f"Magnetics must be a co-energy spline or a law to be written; it is {type(magnetics).__name__}."
    )


def _coefficient_to_dict(c: Coefficient) -> dict[str, Any]:
    return {
        **asdict(c),
        "ci95": list(c.ci95) if c.ci95 else None,
        "bounds": [b if math.isfinite(b) else None for b in c.bounds],
    }


def _spline_to_dict(holder: CoenergySpline | HallSpline) -> dict[str, Any]:
    spline = holder.spline
    return {
        "reference_distance_m": holder.reference_distance_m,
        "distance_shift_m": holder.distance_shift_m,
        "u_knots": spline.x_knots.tolist(),
        "current_knots_A": spline.y_knots.tolist(),
        "u_degree": spline.x_degree,
        "current_degree": spline.y_degree,
        "coefficients": spline.coefficients.tolist(),
    }
