"""What a sweep changes in its actuator file from variant to variant."""

import re
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from femfit.device.decimals import decimal_sum, scaled
from femfit.device.design import Points, Value
from femfit.device.file_numbers import SI_UNITS, Location, unit_of, with_value

AXES = ("current_A", "distance_mm")
"""Grids within each variant where ``[sweep]`` has them, parameters where ``[sweep.parameters]`` does."""

_POSITIONS = re.compile(r"(?:\[\d+\])*\Z")


@dataclass(frozen=True)
class FollowingKey:
    """A number of the file that a parameter sets to offset + factor * value, or a material's name that it sets."""

    location: Location
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class SweptParameter:
    """A parameter of a sweep."""

    name: str
    keys: tuple[FollowingKey, ...]

    @property
    def column(self) -> str:
        """Name in the table, which ends in the SI unit: ``sleeve_radius_mm`` is ``sleeve_radius_m`` there."""
        if not self._unit:
            return self.name
        stem = _POSITIONS.sub("", self.name)
        positions = self.name.removeprefix(stem)
        return f"{stem.removesuffix(f'_{self._unit}')}{positions}_{SI_UNITS.get(self._unit, self._unit)}"

    def in_si(self, value: Value) -> Value:
        """A value of the file in the table's unit."""
        return scaled(value) if self._unit in SI_UNITS and not isinstance(value, str) else value

    @property
    def _unit(self) -> str:
        return unit_of(_POSITIONS.sub("", self.name))


@dataclass(frozen=True)
class ParameterDesign:
    """The variants of a file.

    Parameters
    ----------
    points : tuple of tuple of float or str
        One a variant, one value a parameter, in the file's units or a material's name.
    """

    parameters: tuple[SweptParameter, ...]
    points: Points

    def variant(self, data: Mapping[str, Any], point: tuple[Value, ...]) -> dict[str, Any]:
        """The file of a variant, without ``[sweep.parameters]``."""
        tables = deepcopy(dict(data))
        tables["sweep"] = {key: value for key, value in tables["sweep"].items() if key in AXES}
        for parameter, value in zip(self.parameters, point, strict=True):
            if parameter.name in AXES:
                tables["sweep"][parameter.name] = [value]
                if parameter.name == AXES[1]:
                    tables.pop("reference", None)  # its distances lie within the sweep, not within one point of it
            for key in parameter.keys:
                own = value if isinstance(value, str) else decimal_sum(key.offset, key.factor, value)
                with_value(tables, key.location, own)
        return tables

    def axes(self, data: Mapping[str, Any]) -> dict[str, Any]:
        """``[sweep]`` with each axis that is a parameter as a list of all its values, for the file's own checks."""
        own = dict(data["sweep"])
        for place, parameter in enumerate(self.parameters):
            if parameter.name in AXES:
                own[parameter.name] = sorted({float(point[place]) for point in self.points})
        return own
