"""An actuator from what a sweep's manifest records of it."""

from collections.abc import Mapping
from typing import Any

from pydantic import TypeAdapter, ValidationError

from femfit.actuator.parts import Actuator
from femfit.core.errors import ActuatorFileError


def actuator_from_record(record: Mapping[str, Any], source: str) -> Actuator:
    """Build the actuator again that ``dataclasses.asdict`` made a record of.

    Parameters
    ----------
    record : mapping
        The manifest's ``inputs``.
    source : str
        For messages.

    Returns
    -------
    Actuator
        As it was swept.

    Raises
    ------
    ActuatorFileError
        If the record is not one of this version.
    """
    try:
        return TypeAdapter(Actuator).validate_python(dict(record))
    except ValidationError as error:
        problems = [f"{'.'.join(map(str, fault['loc']))}: {fault['msg']}." for fault in error.errors()]
        raise ActuatorFileError(source, [*problems, "Sweep again, or give the actuator file."]) from error
