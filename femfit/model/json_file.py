"""The model file: JSON in and out, without loss, checked on reading."""

import json
from pathlib import Path

from femfit.core.atomic import write_text
from femfit.core.errors import ModelFileError
from femfit.model.actuator_model import ActuatorModel
from femfit.model.from_json import model_from_dict
from femfit.model.to_json import model_to_dict


def write_model(model: ActuatorModel, path: str | Path) -> None:
    """Write a model file, completely or not at all.

    Parameters
    ----------
    path : Path
        Of the JSON file; its directory is made.

    Raises
    ------
    ModelFileError
        If a value is not finite, or of a kind that JSON does not have.

    Examples
    --------
    >>> import femfit as ff
    >>> model = ff.fit_model("runs/rig").model
    >>> ff.write_model(model, "model.json")
    """
    try:
        text = json.dumps(model_to_dict(model), indent=1, allow_nan=False) + "\n"
    except (TypeError, ValueError) as error:
        raise ModelFileError(
            f"Model {model.name!r} cannot be written as JSON: {error}. Its numbers must be finite and its provenance "
            "made of texts, numbers, lists and mappings."
        ) from error
    write_text(path, text)


def read_model(path: str | Path) -> ActuatorModel:
    """Read a model file.

    Raises
    ------
    ModelFileError
        If the file is missing, no JSON, newer than this femfit, or damaged.

    Examples
    --------
    >>> import femfit as ff
    >>> model = ff.read_model("model.json")
    >>> model.validity.distance_min_m, model.validity.current_max_A
    (0.015, 1.4)
    """
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ModelFileError(f"Model file {path} cannot be read: {error.strerror}.") from error
    except (ValueError, RecursionError) as error:
        raise ModelFileError(f"Model file {path} must be JSON; {error}.") from error
    return model_from_dict(data, str(path))
