"""The model file: JSON in and out, without loss, every value checked on reading."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.errors import MissingPartError, ModelFileError, UsageError
from femfit.core.files import MODEL, path_of, require_outputs, write_text
from femfit.core.results import listing
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_section import read_record, refusal, written
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
    UsageError
        If it is no path.
    ModelFileError
        If the file is missing, no JSON, newer than this femfit, or damaged.

    Examples
    --------
    >>> import femfit as ff
    >>> model = ff.read_model("model.json")
    >>> model.validity.distance_min_m, model.validity.current_max_A
    (0.015, 1.4)
    """
    file = path_of(path, "A model, where it is no ActuatorModel,")
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
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


def model_to_dict(model: ActuatorModel) -> dict[str, Any]:
    """The model as JSON-ready data; of one with effects as it is without them, and the effects."""
    base = model.without_effects
    fitted = {name: getattr(base, name) for name in ("magnetics", "circuits", "motion", "sensor", "eddy")}
    return {"schema": SCHEMA_VERSION, **written(replace(model, **fitted))}


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
    if version <= FIRST_AND_FURTHER:  # its circuits come in one list
        sections = {key: value for key, value in data.items() if key not in {"circuit", "further_circuits"}}
        first, more = data.get("circuit"), data.get("further_circuits") or []
        circuits = [*([] if first is None else [first]), *more] if isinstance(more, list) else more
        data = sections | ({"circuits": circuits} if "circuit" in data else {})
    try:
        model = _build(data, source)
        fault = next(_faults(model), None)
    except (UsageError, MissingPartError) as error:
        raise ModelFileError(f"{source}: {error}") from error
    except (TypeError, LookupError, ArithmeticError, RuntimeError) as error:
        raise ModelFileError(f"{source} is damaged: {error}. Write it again with femfit fit.") from error
    if fault is not None:
        raise ModelFileError(f"{source} is damaged: {fault}. Write it again with femfit fit.")
    return model


def _build(data: Mapping[str, Any], source: str) -> ActuatorModel:
    filed = read_record(ActuatorModel, {key: data[key] for key in data if key != "schema"}, source)
    box = filed.validity
    if not filed.circuits and not box.current_limits_A.any():  # zeros of no winding
        box = replace(box, current_limits_A=box.current_limits_A[:0])
    base = replace(filed, validity=box, effects=())
    drawn, added = {carried.key: carried.effect for carried in base.drawn}, []
    for k, record in enumerate(filed.effects):
        effect = drawn.get(record.name) or (record.carried and record.carried.effect(record.name))  # type: ignore[attr-defined]
        effect = effect or effect_by_name(record.name)  # type: ignore[attr-defined]
        names = [p.name for p in effect.parameters]
        if not {*record.parameters, *record.ci95} <= set(names):
            raise refusal(source, f"effects[{k}]", f"of the parameters {', '.join(names)}", data["effects"][k])
        added.append(AddedEffect(effect, effect.null() | dict(record.parameters), record.ci95))
    return with_effects(base, added)


def _faults(model: ActuatorModel) -> Iterator[str]:
    """What no model can have: a domain that is none, and fields that are not finite all over it."""
    domain, limits, declared = model.validity, model.validity.current_limits_A, list(model.circuit_names)
    several = len(limits) > 1
    rises = limits[:, 0] < limits[:, 1] if several else limits[:, 0] <= limits[:, 1]
    if not (domain.distance_min_m < domain.distance_max_m and rises.all()):
        yield f"validity must span distances and currents in ascending order; instead received {domain}"
    names = list(getattr(model.without_effects.magnetics, "names", ("coil",) * len(limits)))
    alike = not declared or (declared == names if several else len(declared) == len(names))
    if len(names) != len(limits) or len(set(names)) < len(names) or not alike:
        yield (
            f"magnetics, circuits and validity must be of the same circuits; instead received {listing(names)}, "
            f"{listing(declared)} and {len(limits)} ranges of currents"
        )
    d, i = domain.grid(5, 5, several=3)
    # Coefficients near the largest float overflow here instead of in a filter
    with np.errstate(all="ignore"):
        state = model.magnetics.state(d, i)
        values = [state.force, state.motional_constant, state.inductance]
        if model.sensor is not None:
            values.append(model.sensor.output(d, i))
    if not all(np.all(np.isfinite(value)) for value in values):
        yield "force, inductance or Hall voltage is not finite everywhere in the validity domain"
