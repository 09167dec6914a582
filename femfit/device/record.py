"""An actuator from what a sweep's manifest records of it."""

import re
from collections.abc import Mapping
from typing import Any

from pydantic import TypeAdapter, ValidationError

from femfit.core.errors import ActuatorFileError
from femfit.device.parts import Actuator
from femfit.device.schema import NAME_PATTERN


def actuator_from_record(record: Mapping[str, Any], source: str) -> Actuator:
    """Build the actuator again that ``dataclasses.asdict`` made a record of."""
    try:
        actuator = TypeAdapter(Actuator).validate_python(dict(record))
    except ValidationError as error:
        problems = [f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}." for fault in error.errors()]
        raise ActuatorFileError(source, [*problems, "Sweep again, or give the actuator file."]) from error
    if re.fullmatch(NAME_PATTERN, actuator.name) is None:  # directories are named after it
        given = f"instead received {actuator.name[:64]!r}. Sweep again."
        raise ActuatorFileError(source, [f"name: must begin with a letter and hold letters, digits, - and _; {given}"])
    return actuator
