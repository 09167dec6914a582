"""The model file: JSON in and out, without loss, every value checked on reading."""

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.errors import ModelFileError
from femfit.core.files import MODEL, path_of, require_outputs, write_text
from femfit.core.numerics import ABSOLUTE_ZERO_C
from femfit.core.results import listing
from femfit.device.electrics import Circuit, Drive, Sensor
from femfit.device.mechanics import ForceTable, Mechanics, Spring, Stop
from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import REFERENCE_TEMPERATURE_C
from femfit.effects.effect import AddedEffect, Effect
from femfit.model.actuator_model import ActuatorModel
from femfit.model.carried import Carried
from femfit.model.drawn_effect import DrawnEffect
from femfit.model.eddy_currents import EddyCurrents
from femfit.model.hall import HallField, HallSensor, HallSpline, PickupSensor, SensedField
from femfit.model.json_effects import carried_from, carried_to, drawn_from, drawn_to
from femfit.model.json_magnetics import (
    NETWORK_KIND,
    magnetics_from,
    matrix_to,
    spline_to,
    tensor_to,
)
from femfit.model.json_parts import (
    eddy_from,
    eddy_to,
    hall_field_from,
    mechanics_from,
    sensed_to,
    sensors_from,
    unusual,
)
from femfit.model.json_section import Section, plain
from femfit.model.magnetics import Coefficient, CoenergySpline, LawMagnetics
from femfit.model.network_magnetics import NetworkMagnetics
from femfit.model.sensed_effects import pickups_as_fitted
from femfit.model.several_magnetics import CoenergyMatrix, CoenergyTensor
from femfit.model.validity import ActuatorKind, Misfit, ProcessNoise, ValidityBox
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


SCHEMA_VERSION = 3

FIRST_AND_FURTHER = 2
"""Last schema whose circuits stand under two keys, the first under ``circuit``, the others in ``further_circuits``."""

_WORKED_OUT = {"base", "conditions"}
"""Fields of a model that follow from its base and its effects: the file holds the base itself."""


def model_to_dict(model: ActuatorModel) -> dict[str, Any]:
    """The model as JSON-ready data."""
    written = (
        CoenergySpline
        | CoenergyMatrix
        | CoenergyTensor
        | LawMagnetics
        | NetworkMagnetics
        | HallSpline
        | SensedField
        | None
    )
    for held in (model.without_effects.magnetics, getattr(model.without_effects.sensor, "field", None)):
        if not isinstance(held, written):
            raise ModelFileError(
                "To be written, magnetics must be a co-energy spline or a law, and the field at the Hall element a "
                f"spline; it is {type(held).__name__}."
            )
    base, changed = model.without_effects, ("magnetics", "circuits", "motion", "sensor", "eddy")
    names = [f.name for f in fields(model) if f.name not in _WORKED_OUT]
    data = {name: plain(getattr(base if name in changed else model, name), _record) for name in names}
    data["other_sensors"] = plain(pickups_as_fitted(model.other_sensors, base.other_sensors), _record)
    for key in ("other_sensors", "process_noise", "drawn", "eddy"):  # as files were before there were any
        if not data[key]:
            del data[key]
    return {"schema": SCHEMA_VERSION, **data}


def _record(value: Any) -> dict[str, Any]:
    """The members of a record as the file has them, before what they hold is written."""
    if isinstance(value, AddedEffect):
        carried = {"carried": carried_to(value.effect)} if isinstance(value.effect.carried, Carried) else {}
        return {"name": value.effect.name, "parameters": value.parameters, "ci95": value.ci95, **carried}
    if isinstance(value, CoenergySpline | HallSpline):
        kind = {} if isinstance(value, HallSpline) else {"kind": "coenergy_spline"}
        return kind | spline_to(value.coordinate, value.spline)
    if isinstance(value, Mechanics | Spring | ForceTable | Stop | Circuit | Drive | Sensor):
        return unusual(value)
    if type(value) in _WRITERS:
        return _WRITERS[type(value)](value)
    data = {f.name: getattr(value, f.name) for f in fields(value)}
    if isinstance(value, HallSensor):  # as files were before it could be late or slow
        data = {key: one for key, one in data.items() if one or key not in {"delay_s", "sample_time_s"}}
    if isinstance(value, NetworkMagnetics):
        data = {"kind": NETWORK_KIND, **data}
    if isinstance(value, LawMagnetics):
        return {"kind": "law", "law": data.pop("law_name"), **data}
    if isinstance(value, Coefficient):
        data["bounds"] = [bound if math.isfinite(bound) else None for bound in value.bounds]
    return data


@dataclass(frozen=True)
class _WrittenBox:
    """A validity domain as a model file has it: currents of the first circuit, and of the further ones."""

    distance_min_m: float
    distance_max_m: float
    current_min_A: float
    current_max_A: float
    further_A: tuple[tuple[float, float], ...] = ()
    mirrored: bool = False

    def read(self, winding: bool) -> ValidityBox:
        """The domain; of no winding, whose currents are zero, it has no limits of currents."""
        distances, first = (self.distance_min_m, self.distance_max_m), (self.current_min_A, self.current_max_A)
        return ValidityBox.of_currents(distances, first, *self.further_A, winding=winding, mirrored=self.mirrored)


_WRITERS: dict[type, Callable[[Any], dict[str, Any]]] = {
    EddyCurrents: eddy_to,
    DrawnEffect: drawn_to,
    SensedField: sensed_to,
    CoenergyMatrix: matrix_to,
    CoenergyTensor: tensor_to,
    ValidityBox: lambda box: {
        "distance_min_m": box.distance_min_m,
        "distance_max_m": box.distance_max_m,
        "current_min_A": box.current_min_A,
        "current_max_A": box.current_max_A,
        "further_A": box.current_limits_A[1:].tolist(),
        "mirrored": box.mirrored,
    },
}


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
    model = _build(Section(source, "", data if version > FIRST_AND_FURTHER else _with_one_list(data)))
    fault = next(_faults(model), None)
    if fault is not None:
        raise ModelFileError(f"{source} is damaged: {fault}. Write it again with femfit fit.")
    return model


def _with_one_list(data: Mapping[str, Any]) -> dict[str, Any]:
    """Data of :data:`FIRST_AND_FURTHER` or before with its circuits in one list."""
    kept = {key: value for key, value in data.items() if key not in {"circuit", "further_circuits"}}
    first, further = data.get("circuit"), data.get("further_circuits") or []
    circuits = [*([] if first is None else [first]), *further] if isinstance(further, list) else further
    return kept | ({"circuits": circuits} if "circuit" in data else {})


def _build(top: Section) -> ActuatorModel:
    top.refuse_others(("schema", *(f.name for f in fields(ActuatorModel) if f.name not in _WORKED_OUT)))
    motion, sensor, misfit = (top.optional_section(name) for name in ("motion", "sensor", "misfit"))
    kind, noise, eddy = (top.optional_section(name) for name in ("kind", "process_noise", "eddy"))
    circuits = tuple(one.record(Circuit) for one in top.sections("circuits")) if top.data.get("circuits") else ()
    base = ActuatorModel(
        name=top.text("name"),
        magnetics=magnetics_from(top.section("magnetics")),
        validity=top.section("validity").record(_WrittenBox).read(bool(circuits)),
        circuits=circuits,
        motion=mechanics_from(motion) if motion else None,
        sensor=sensor.record(HallSensor, field=hall_field_from(sensor.section("field"))) if sensor else None,
        misfit=misfit.record(Misfit) if misfit else None,
        sample_time_s=top.number("sample_time_s", positive=True),
        reference_distances_m=tuple(top.array("reference_distances_m", 1).tolist()),
        covariance=None if top.data.get("covariance") is None else top.array("covariance", 2),
        provenance=dict(top.section("provenance").data),
        coil_temperature_C=top.number("coil_temperature_C", lower=ABSOLUTE_ZERO_C, absent=REFERENCE_TEMPERATURE_C),
        magnet_temperature_C=top.number("magnet_temperature_C", lower=ABSOLUTE_ZERO_C, absent=REFERENCE_TEMPERATURE_C),
        kind=kind.record(ActuatorKind) if kind else None,
        process_noise=noise.record(ProcessNoise) if noise else None,
        other_sensors=sensors_from(top.sections("other_sensors")) if top.data.get("other_sensors") else (),
        drawn=tuple(map(drawn_from, top.sections("drawn"))) if top.data.get("drawn") else (),
        eddy=eddy_from(eddy, tuple(one.name for one in circuits)) if eddy else None,
    )
    added = top.sections("effects") if top.data.get("effects") else ()
    drawn = {one.key: one.effect for one in base.drawn}
    return with_effects(base, [_effect_from(section, drawn) for section in added])


def _effect_from(section: Section, drawn: Mapping[str, Effect]) -> AddedEffect:
    section.refuse_others(("name", "parameters", "ci95", "carried"))
    carried = section.optional_section("carried")
    effect = drawn.get(section.text("name"))
    if effect is None:
        effect = carried_from(section.text("name"), carried) if carried else section.item("name", effect_by_name)
    names = tuple(p.name for p in effect.parameters)
    parameters, intervals = section.section("parameters"), section.section("ci95")
    parameters.refuse_others(names)
    intervals.refuse_others(names)
    return AddedEffect(
        effect=effect,
        parameters={name: parameters.number(name) for name in names},
        ci95={name: intervals.pair(name) for name in names if name in intervals.data},
    )


def _faults(model: ActuatorModel) -> Iterator[str]:
    """What no model can have: a domain that is none, and fields that are not finite in it (in 25 points)."""
    domain, circuits = model.validity, model.circuits
    if not (
        domain.distance_min_m < domain.distance_max_m
        and (domain.current_limits_A[:, 0] <= domain.current_limits_A[:, 1]).all()
    ):
        yield f"validity must span distances and currents in ascending order; instead received {domain}"
    sensed: list[tuple[str, HallField]] = [(s.name, s.flux) for s in model.other_sensors if isinstance(s, PickupSensor)]
    sensed += [("field", model.sensor.field)] if model.sensor is not None else []
    for name, held in (("magnetics", model.without_effects.magnetics), *sensed):
        coordinate = getattr(held, "coordinate", None)
        if coordinate is not None and not coordinate.finite_between(domain.distance_min_m, domain.distance_max_m):
            yield (
                f"d_0 / (d + s) of its {name} must be finite in the validity domain; with a distance_shift_m of "
                f"{coordinate.distance_shift_m:g} it is not"
            )
    limits = domain.current_limits_A
    names = getattr(model.without_effects.magnetics, "names", ("coil",) * len(limits))
    if not (len(names) == len(limits) and len(circuits) in {0, len(limits)}):
        yield (
            f"magnetics, circuits and validity must be of as many circuits; instead received {len(names)}, "
            f"{len(circuits)} and {len(limits)}"
        )
    declared = [circuit.name for circuit in circuits]
    if len(set(names)) < len(names) or (declared and len(names) > 1 and declared != list(names)):
        yield (
            f"the circuits of its magnetics ({listing(names)}) must have a name each, and be those of its circuits "
            f"({listing(declared)}), in their order"
        )
    if len(names) > 1 and not np.all(limits[:, 0] < limits[:, 1]):
        yield f"validity must span a range of each circuit's current; instead received {limits.tolist()} A"
    d, along = np.meshgrid(np.linspace(domain.distance_min_m, domain.distance_max_m, 5), np.linspace(0.0, 1.0, 5))
    i = limits[:, 0] + along[..., None] * (limits[:, 1] - limits[:, 0])
    # Coefficients near the largest float overflow here instead of in a filter
    with np.errstate(all="ignore"):
        state = model.magnetics.state(d, i)
        values = [state.force, state.motional_constant, state.inductance]
        if model.sensor is not None:
            values.append(model.sensor.output(d, i))
    if not all(np.all(np.isfinite(value)) for value in values):
        yield "force, inductance or Hall voltage is not finite everywhere in the validity domain"
