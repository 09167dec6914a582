"""The model file: JSON in and out, without loss, checked on reading."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.errors import ModelFileError
from femfit.model.actuator_model import ActuatorModel, Circuit, HallSensor, Misfit, Motion, ValidityBox
from femfit.model.bspline import TensorSpline
from femfit.model.hall import HallField
from femfit.model.magnetics import Coefficient, CoenergySpline, LawMagnetics, Magnetics

SCHEMA_VERSION = 1


def model_to_dict(model: ActuatorModel) -> dict[str, Any]:
    """The model as JSON-ready data.

    Parameters
    ----------
    model : ActuatorModel
        Any.

    Returns
    -------
    dict
        Floats keep all their digits; infinite bounds become null.
    """
    sensor = None
    if model.sensor is not None:
        sensor = {key: value for key, value in vars(model.sensor).items() if key != "field"}
        sensor["field"] = _spline_to_dict(model.sensor.field.reference_distance_m, model.sensor.field.spline)
    return {
        "schema": SCHEMA_VERSION,
        "name": model.name,
        "magnetics": _magnetics_to_dict(model.magnetics),
        "validity": asdict(model.validity),
        "circuit": asdict(model.circuit) if model.circuit else None,
        "motion": asdict(model.motion) if model.motion else None,
        "sensor": sensor,
        "misfit": asdict(model.misfit) if model.misfit else None,
        "sample_time_s": model.sample_time_s,
        "reference_distances_m": list(model.reference_distances_m),
        "covariance": None if model.covariance is None else model.covariance.tolist(),
        "effects": [dict(effect) for effect in model.effects],
        "provenance": dict(model.provenance),
    }


def model_from_dict(data: Mapping[str, Any], source: str = "model") -> ActuatorModel:
    """Build a model from JSON data.

    Parameters
    ----------
    data : mapping
        As written by :func:`model_to_dict`.
    source : str
        Name for messages.

    Returns
    -------
    ActuatorModel
        The model.

    Raises
    ------
    ModelFileError
        If the schema is newer than this femfit knows, or a key is missing or of the wrong kind.
    """
    if not isinstance(data, Mapping) or not isinstance(data.get("schema"), int):
        raise ModelFileError(f"{source} must be a femfit model file with an integer key 'schema'; it has none.")
    if data["schema"] > SCHEMA_VERSION:
        raise ModelFileError(
            f"{source} has schema {data['schema']}; this femfit reads up to schema {SCHEMA_VERSION}. "
            "Update femfit, or write the model again with this version."
        )
    if data.get("effects"):
        raise ModelFileError(
            f"{source} lists added effects ({', '.join(str(e.get('name')) for e in data['effects'])}), which this "
            "femfit cannot evaluate. Update femfit; leaving them out would give silently different numbers."
        )
    try:
        model = _build(data)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise ModelFileError(
            f"{source} is damaged: {type(error).__name__} {error}. Write it again with femfit fit."
        ) from error
    _check_finite(model, source)
    return model


def write_model(model: ActuatorModel, path: Path) -> None:
    """Write a model file, completely or not at all.

    Parameters
    ----------
    model : ActuatorModel
        Any.
    path : Path
        Of the JSON file; its directory must exist.
    """
    path = Path(path)
    partial = path.with_name(path.name + ".partial")
    partial.write_text(json.dumps(model_to_dict(model), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    partial.replace(path)


def read_model(path: Path) -> ActuatorModel:
    """Read a model file.

    Parameters
    ----------
    path : Path
        Of the JSON file.

    Returns
    -------
    ActuatorModel
        The model.

    Raises
    ------
    ModelFileError
        If the file is missing, no JSON, newer than this femfit, or damaged.
    """
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ModelFileError(f"Model file {path} cannot be read: {error.strerror}.") from error
    except ValueError as error:
        raise ModelFileError(f"Model file {path} must be JSON; {error}.") from error
    return model_from_dict(data, str(path))


def _build(data: Mapping[str, Any]) -> ActuatorModel:
    sensor = None
    if data.get("sensor"):
        values = dict(data["sensor"])
        reference, spline = _spline_from_dict(values.pop("field"))
        sensor = HallSensor(field=HallField(reference, spline), **values)
    covariance = data.get("covariance")
    return ActuatorModel(
        name=str(data["name"]),
        magnetics=_magnetics_from_dict(data["magnetics"]),
        validity=ValidityBox(**data["validity"]),
        circuit=Circuit(**data["circuit"]) if data.get("circuit") else None,
        motion=Motion(**data["motion"]) if data.get("motion") else None,
        sensor=sensor,
        misfit=Misfit(**data["misfit"]) if data.get("misfit") else None,
        sample_time_s=float(data["sample_time_s"]),
        reference_distances_m=tuple(float(d) for d in data.get("reference_distances_m", ())),
        covariance=None if covariance is None else np.asarray(covariance, dtype=np.float64),
        provenance=dict(data.get("provenance") or {}),
    )


def _check_finite(model: ActuatorModel, source: str) -> None:
    box = model.validity
    d, i = np.meshgrid(
        np.linspace(box.distance_min_m, box.distance_max_m, 5),
        np.linspace(box.current_min_A, box.current_max_A, 5),
    )
    if not (box.distance_min_m > 0 and box.distance_max_m > box.distance_min_m):
        raise ModelFileError(f"{source}: validity must span an interval of distances > 0; it does not.")
    if not np.all(np.isfinite(model.magnetics.force(d, i))):
        raise ModelFileError(f"{source}: the force is not finite everywhere in the validity box. Fit the model again.")


def _magnetics_to_dict(magnetics: Magnetics) -> dict[str, Any]:
    if isinstance(magnetics, CoenergySpline):
        return {
            "kind": "coenergy_spline",
            **_spline_to_dict(magnetics.reference_distance_m, magnetics.spline),
        }
    if isinstance(magnetics, LawMagnetics):
        return {
            "kind": "law",
            "law": magnetics.law_name,
            "shape": dict(magnetics.shape),
            "coefficients": [_coefficient_to_dict(c) for c in magnetics.coefficients],
            "constant_inductance_H": magnetics.constant_inductance_H,
            "constant_flux_linkage_Wb": magnetics.constant_flux_linkage_Wb,
        }
    raise ModelFileError(
        f"Magnetics must be a co-energy spline or a law to be written; it is {type(magnetics).__name__}."
    )


def _magnetics_from_dict(data: Mapping[str, Any]) -> Magnetics:
    if data["kind"] == "coenergy_spline":
        reference, spline = _spline_from_dict(data)
        return CoenergySpline(reference, spline)
    if data["kind"] == "law":
        magnetics = LawMagnetics(
            law_name=data["law"],
            coefficients=tuple(_coefficient_from_dict(c) for c in data["coefficients"]),
            shape={key: float(value) for key, value in data["shape"].items()},
            constant_inductance_H=float(data["constant_inductance_H"]),
            constant_flux_linkage_Wb=float(data["constant_flux_linkage_Wb"]),
        )
        known = magnetics.law.basis
        for coefficient in magnetics.coefficients:
            if coefficient.basis not in known:
                raise ValueError(f"column {coefficient.basis!r} of law {data['law']} (it has {', '.join(known)})")
        return magnetics
    raise ValueError(f"magnetics kind {data['kind']!r}")


def _coefficient_to_dict(c: Coefficient) -> dict[str, Any]:
    return {
        **asdict(c),
        "ci95": list(c.ci95) if c.ci95 else None,
        "bounds": [b if math.isfinite(b) else None for b in c.bounds],
    }


def _coefficient_from_dict(data: Mapping[str, Any]) -> Coefficient:
    lower, upper = data.get("bounds", (None, None))
    return Coefficient(
        basis=data["basis"],
        current_power=int(data["current_power"]),
        value=float(data["value"]),
        unit=data["unit"],
        ci95=(float(data["ci95"][0]), float(data["ci95"][1])) if data.get("ci95") else None,
        bounds=(-math.inf if lower is None else lower, math.inf if upper is None else upper),
        active=data.get("active", ""),
    )


def _spline_to_dict(reference_distance_m: float, spline: TensorSpline) -> dict[str, Any]:
    return {
        "reference_distance_m": reference_distance_m,
        "u_knots": spline.x_knots.tolist(),
        "current_knots_A": spline.y_knots.tolist(),
        "u_degree": spline.x_degree,
        "current_degree": spline.y_degree,
        "coefficients": spline.coefficients.tolist(),
    }


def _spline_from_dict(data: Mapping[str, Any]) -> tuple[float, TensorSpline]:
    spline = TensorSpline(
        x_knots=np.asarray(data["u_knots"], dtype=np.float64),
        y_knots=np.asarray(data["current_knots_A"], dtype=np.float64),
        x_degree=int(data["u_degree"]),
        y_degree=int(data["current_degree"]),
        coefficients=np.asarray(data["coefficients"], dtype=np.float64),
    )
    needed = (len(spline.x_knots) - spline.x_degree - 1, len(spline.y_knots) - spline.y_degree - 1)
    if spline.coefficients.shape != needed:
        raise ValueError(f"spline coefficients of shape {spline.coefficients.shape}, knots ask for {needed}")
    return float(data["reference_distance_m"]), spline
