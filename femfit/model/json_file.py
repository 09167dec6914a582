"""The model file: JSON in and out, without loss, every value checked on reading."""

import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from femfit.core.atomic import write_text
from femfit.core.constants import ABSOLUTE_ZERO_C
from femfit.core.errors import ModelFileError
from femfit.core.outputs import MODEL, require_outputs
from femfit.core.paths import path_of
from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import REFERENCE_TEMPERATURE_C
from femfit.effects.effect import AddedEffect
from femfit.laws.catalogue import law_by_name
from femfit.model.actuator_kind import ActuatorKind
from femfit.model.actuator_model import ActuatorModel, Circuit, HallSensor, Misfit, Motion, ValidityBox
from femfit.model.bspline import TensorSpline, is_clamped
from femfit.model.hall import HallSpline
from femfit.model.json_section import Section
from femfit.model.magnetics import Coefficient, CoenergySpline, LawMagnetics, Magnetics
from femfit.model.with_effects import with_effects


def write_model(model: ActuatorModel, path: str | Path) -> None:
    """Write a model file, completely or not at all.

    Parameters
    ----------
    path : Path
        Of the JSON file; its directory is made.

    Raises
    ------
    ModelFileError
        If it is no model, a value is not finite, or of a kind that JSON does not have.
    OutputError
        If the file there is no model file.

    Examples
    --------
    >>> import femfit as ff
    >>> model = ff.fit_model("runs/rig").model
    >>> ff.write_model(model, "model.json")
    """
    if not isinstance(model, ActuatorModel):
        raise ModelFileError(
            f"What is written must be an ActuatorModel; instead received {type(model).__name__}. Give what read_model "
            "or fit_model(...).model returns."
        )
    try:
        text = json.dumps(model_to_dict(model), indent=1, allow_nan=False) + "\n"
    except (TypeError, ValueError) as error:
        raise ModelFileError(
            f"Model {model.name!r} cannot be written as JSON: {error}. Its numbers must be finite and its provenance "
            "made of texts, numbers, lists and mappings."
        ) from error
    require_outputs([], (path_of(path, "The model file"), MODEL))
    write_text(path, text)


def read_model(path: str | Path) -> ActuatorModel:
    """Read a model file.

    Raises
    ------
    ModelFileError
        If it is no path, or the file is missing, no JSON, newer than this femfit, or damaged.

    Examples
    --------
    >>> import femfit as ff
    >>> model = ff.read_model("model.json")
    >>> model.validity.distance_min_m, model.validity.current_max_A
    (0.015, 1.4)
    """
    if not isinstance(path, str | Path):
        raise ModelFileError(
            f"A model must be an ActuatorModel or the path of a model file; instead received {type(path).__name__}. "
            "Give what read_model or fit_model(...).model returns."
        )
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ModelFileError(f"Model file {path} cannot be read: {error.strerror}.") from error
    except (ValueError, RecursionError) as error:
        raise ModelFileError(f"Model file {path} must be JSON; {error}.") from error
    return model_from_dict(data, str(path))


def model_of(model: ActuatorModel | str | Path) -> ActuatorModel:
    """The model, read where a path is given."""
    return model if isinstance(model, ActuatorModel) else read_model(model)


if TYPE_CHECKING:
    from _typeshed import DataclassInstance

SCHEMA_VERSION = 1

_WORKED_OUT = {"base", "dynamics"}
"""Fields of a model that follow from its base and its effects: the file holds the base itself."""


def model_to_dict(model: ActuatorModel) -> dict[str, Any]:
    """The model as JSON-ready data."""
    for held in (model.without_effects.magnetics, getattr(model.without_effects.sensor, "field", None)):
        if not isinstance(held, CoenergySpline | LawMagnetics | HallSpline | None):
            raise ModelFileError(
                "To be written, magnetics must be a co-energy spline or a law, and the field at the Hall element a "
                f"spline; it is {type(held).__name__}."
            )
    base, changed = model.without_effects, ("magnetics", "circuit", "motion", "sensor")
    names = [f.name for f in fields(model) if f.name not in _WORKED_OUT]
    data = {name: _plain(getattr(base if name in changed else model, name)) for name in names}
    return {"schema": SCHEMA_VERSION, **data}


def _plain(value: object) -> Any:
    """Dataclasses as mappings of their fields, arrays and tuples as lists; what JSON has as it is."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(one) for one in value]
    return _record(value) if is_dataclass(value) and not isinstance(value, type) else value


def _record(value: "DataclassInstance") -> dict[str, Any]:
    if isinstance(value, AddedEffect):
        return {"name": value.effect.name, "parameters": dict(value.parameters), "ci95": _plain(value.ci95)}
    if isinstance(value, CoenergySpline | HallSpline):
        spline, kind = value.spline, {} if isinstance(value, HallSpline) else {"kind": "coenergy_spline"}
        return kind | {
            "reference_distance_m": value.reference_distance_m,
            "distance_shift_m": value.distance_shift_m,
            "u_knots": spline.x_knots.tolist(),
            "current_knots_A": spline.y_knots.tolist(),
            "u_degree": spline.x_degree,
            "current_degree": spline.y_degree,
            "coefficients": spline.coefficients.tolist(),
        }
    data = {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, LawMagnetics):
        return {"kind": "law", "law": data.pop("law_name"), **data}
    if isinstance(value, Coefficient):
        data["bounds"] = [bound if math.isfinite(bound) else None for bound in value.bounds]
    return data


def model_from_dict(data: Mapping[str, Any], source: str = "model") -> ActuatorModel:
    """Build a model from JSON data."""
    version = data.get("schema") if isinstance(data, Mapping) else None
    if isinstance(version, bool) or not isinstance(version, int) or version < 1:
        raise ModelFileError(f"{source} must be a femfit model file with a key 'schema' of 1 or more; it has none.")
    if version > SCHEMA_VERSION:
        raise ModelFileError(
            f"{source} has schema {version}; this femfit reads up to schema {SCHEMA_VERSION}. "
            "Update femfit, or write the model again with this version."
        )
    model = _build(Section(source, "", data))
    _check_values(model, source)
    return model


def _build(top: Section) -> ActuatorModel:
    top.refuse_others(("schema", *(f.name for f in fields(ActuatorModel) if f.name not in _WORKED_OUT)))
    circuit, motion = top.optional_section("circuit"), top.optional_section("motion")
    sensor, misfit = top.optional_section("sensor"), top.optional_section("misfit")
    kind = top.optional_section("kind")
    base = ActuatorModel(
        name=top.text("name"),
        magnetics=_magnetics_from(top.section("magnetics")),
        validity=top.section("validity").record(ValidityBox),
        circuit=circuit.record(Circuit) if circuit else None,
        motion=motion.record(Motion) if motion else None,
        sensor=sensor.record(HallSensor, field=HallSpline(*_spline_from(sensor.section("field")))) if sensor else None,
        misfit=misfit.record(Misfit) if misfit else None,
        sample_time_s=top.number("sample_time_s", positive=True),
        reference_distances_m=tuple(top.array("reference_distances_m", 1).tolist()),
        covariance=None if top.data.get("covariance") is None else top.array("covariance", 2),
        provenance=dict(top.section("provenance").data),
        coil_temperature_C=top.number("coil_temperature_C", lower=ABSOLUTE_ZERO_C, absent=REFERENCE_TEMPERATURE_C),
        magnet_temperature_C=top.number("magnet_temperature_C", lower=ABSOLUTE_ZERO_C, absent=REFERENCE_TEMPERATURE_C),
        kind=kind.record(ActuatorKind) if kind else None,
    )
    added = top.sections("effects") if top.data.get("effects") else ()
    return with_effects(base, [_effect_from(section) for section in added])


def _effect_from(section: Section) -> AddedEffect:
    section.refuse_others(("name", "parameters", "ci95"))
    effect = section.item("name", effect_by_name)
    names = tuple(p.name for p in effect.parameters)
    parameters, intervals = section.section("parameters"), section.section("ci95")
    parameters.refuse_others(names)
    intervals.refuse_others(names)
    pairs = {name: intervals.array(name, 1) for name in names if name in intervals.data}
    for name, pair in pairs.items():
        if len(pair) != 2:
            raise intervals.refusal(name, "a pair of numbers")
    return AddedEffect(
        effect=effect,
        parameters={name: parameters.number(name) for name in names},
        ci95={name: (float(pair[0]), float(pair[1])) for name, pair in pairs.items()},
    )


def _check_values(model: ActuatorModel, source: str) -> None:
    """Refuse a domain that is none, and fields that are not finite in it (in 25 points)."""
    domain = model.validity
    if not (0 < domain.distance_min_m < domain.distance_max_m and domain.current_min_A <= domain.current_max_A):
        raise ModelFileError(
            f"{source} is damaged: validity must span distances > 0 and currents in ascending order; instead received "
            f"{domain}. Write it again with femfit fit."
        )
    d, i = np.meshgrid(
        np.linspace(domain.distance_min_m, domain.distance_max_m, 5),
        np.linspace(domain.current_min_A, domain.current_max_A, 5),
    )
    # Coefficients near the largest float overflow here instead of in a filter
    with np.errstate(all="ignore"):
        state = model.magnetics.state(d, i)
        values = [state.force, state.motional_constant, state.inductance]
        if model.sensor is not None:
            values.append(model.sensor.voltage(d, i))
    if not np.all(np.isfinite(values)):
        raise ModelFileError(
            f"{source} is damaged: force, inductance or Hall voltage is not finite everywhere in the validity domain. "
            "Write it again with femfit fit."
        )


def _magnetics_from(section: Section) -> Magnetics:
    kind = section.text("kind")
    if kind == "coenergy_spline":
        return CoenergySpline(*_spline_from(section))
    if kind != "law":
        raise section.refusal("kind", "coenergy_spline or law")
    law = section.item("law", law_by_name)
    section.section("shape").refuse_others(tuple(p.name for p in law.shape))
    return LawMagnetics(
        law_name=law.name,
        coefficients=tuple(_coefficient_from(item, law.basis) for item in section.sections("coefficients")),
        shape={p.name: section.section("shape").number(p.name) for p in law.shape},
        constant_inductance_H=section.number("constant_inductance_H"),
        constant_flux_linkage_Wb=section.number("constant_flux_linkage_Wb"),
        reference_distance_m=section.optional_number("reference_distance_m"),
    )


def _coefficient_from(section: Section, basis: tuple[str, ...]) -> Coefficient:
    if section.text("basis") not in basis:
        raise section.refusal("basis", f"a column of the law ({', '.join(basis)})")
    interval = None if section.data.get("ci95") is None else section.array("ci95", 1)
    bounds = section.data.get("bounds")
    if not isinstance(bounds, list) or len(bounds) != 2 or (interval is not None and len(interval) != 2):
        raise section.refusal("bounds", "a pair, as ci95, with null for a bound that is none")
    ends = Section(section.source, section.where("bounds"), dict(zip(("lower", "upper"), bounds, strict=True)))
    lower, upper = ends.optional_number("lower"), ends.optional_number("upper")
    return Coefficient(
        basis=section.text("basis"),
        current_power=section.integer("current_power", 0, 16),
        value=section.number("value"),
        unit=section.text("unit"),
        ci95=None if interval is None else (float(interval[0]), float(interval[1])),
        bounds=(-math.inf if lower is None else lower, math.inf if upper is None else upper),
        active=section.text("active"),
    )


def _spline_from(section: Section) -> tuple[float, TensorSpline, float]:
    """d_0, spline and shift of a co-energy or a Hall field."""
    spline = TensorSpline(
        x_knots=section.array("u_knots", 1),
        y_knots=section.array("current_knots_A", 1),
        x_degree=section.integer("u_degree", 1, 9),
        y_degree=section.integer("current_degree", 1, 9),
        coefficients=section.array("coefficients", 2),
    )
    for key, knots, degree in (
        ("u_knots", spline.x_knots, spline.x_degree),
        ("current_knots_A", spline.y_knots, spline.y_degree),
    ):
        if not is_clamped(knots, degree):
            raise section.refusal(key, f"ascending, with {degree + 1} equal knots at both ends and fewer inside")
    needed = (len(spline.x_knots) - spline.x_degree - 1, len(spline.y_knots) - spline.y_degree - 1)
    if spline.coefficients.shape != needed:
        raise section.refusal("coefficients", f"{needed[0]} lists of {needed[1]} numbers, as the knots ask for")
    shift = section.number("distance_shift_m", lower=0.0, absent=0.0)
    return section.number("reference_distance_m", positive=True), spline, shift
