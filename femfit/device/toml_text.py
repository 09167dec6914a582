"""An actuator file's text and its tables, before anything in them is checked."""

import tomllib
from pathlib import Path
from typing import Any

from femfit.core.errors import ActuatorFileError
from femfit.device.schema import SCHEMA_VERSION


def read_text(path: Path) -> str:
    """The text of an actuator file."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise ActuatorFileError(str(path), ["does not exist. Give the path of an actuator .toml file."]) from error
    except OSError as error:
        raise ActuatorFileError(str(path), [f"cannot be read: {error.strerror}."]) from error
    except UnicodeDecodeError as error:
        raise ActuatorFileError(str(path), [f"must be UTF-8 text; byte {error.start} is not. Save it so."]) from error


def parse(text: str, source: str) -> dict[str, Any]:
    """The tables of TOML text."""
    try:
        data = tomllib.loads(text)
    except RecursionError as error:
        raise ActuatorFileError(source, ["must be TOML; its brackets are nested too deeply."]) from error
    except ValueError as error:  # TOMLDecodeError, or a number with too many digits
        raise ActuatorFileError(source, [f"must be TOML; {error}. Correct that place first."]) from error
    version = data.get("schema")
    if isinstance(version, int) and version > SCHEMA_VERSION:
        raise ActuatorFileError(
            source,
            [f"schema is {version}; this femfit reads up to schema {SCHEMA_VERSION}. Update femfit, or write it so."],
        )
    return data
