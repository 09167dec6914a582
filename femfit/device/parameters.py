"""[sweep.parameters]: what of a file is swept, and the points of the sweep.

References
----------
M. D. McKay, R. J. Beckman and W. J. Conover, Technometrics 21 (1979) 239: Latin hypercube sampling.
"""

import re
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from femfit.device.complaints import complain
from femfit.device.decimals import decimal_sum, scaled
from femfit.device.file_numbers import Location, with_value
from femfit.device.keys import SI_UNITS, unit_of
from femfit.device.schema import MAX_AXIS_POINTS, SampledEntry

Value = float | str
"""Value of a parameter: a number, or the name of a material."""

Points = tuple[tuple[Value, ...], ...]
"""One tuple a point, one value a parameter."""


def grid_points(values: Sequence[Sequence[Value]], problems: list[str]) -> Points:
    """Every combination, the last parameter fastest."""
    count = int(np.prod([float(len(column)) for column in values]))
    if count > MAX_AXIS_POINTS:
        complain(problems, "many_points", most=MAX_AXIS_POINTS, count=count)
        return ()
    return tuple(product(*values))


def list_points(names: Sequence[str], values: Sequence[Sequence[Value]], problems: list[str]) -> Points:
    """The first values together, the second ones together, and so on."""
    if len({len(column) for column in values}) > 1:
        lengths = ", ".join(f"{name} {len(column)}" for name, column in zip(names, values, strict=True))
        complain(problems, "list_lengths", lengths=lengths)
        return ()
    return tuple(zip(*values, strict=True))


def latin_hypercube(ranges: Sequence[SampledEntry | Sequence[str]], samples: int, seed: int) -> Points:
    """Samples of which each of equally many slices of every range holds one.

    Returns
    -------
    tuple of tuple of float or str
        With a step, values are those of the steps whose equal shares of the range the samples fall into.
    """
    from scipy.stats import qmc  # noqa: PLC0415  half a second that other actuator files need not spend

    shares = qmc.LatinHypercube(len(ranges), rng=np.random.default_rng(seed)).random(samples)
    return tuple(
        tuple(_at_share(entry, float(share)) for entry, share in zip(ranges, row, strict=True)) for row in shares
    )


def _at_share(entry: SampledEntry | Sequence[str], share: float) -> Value:
    if not isinstance(entry, SampledEntry):
        return entry[int(share * len(entry))]
    if entry.step is None:
        return entry.min + share * (entry.max - entry.min)
    steps = round((entry.max - entry.min) / entry.step)
    return decimal_sum(entry.min, min(int(share * (steps + 1)), steps), entry.step)


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
    """The variants of a file."""

    parameters: tuple[SweptParameter, ...]
    points: Points  # One a variant, one value a parameter, in the file's units or a material's name

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
                number = value if isinstance(value, str) else decimal_sum(key.offset, key.factor, value)
                with_value(tables, key.location, number)
        return tables

    def axes(self, data: Mapping[str, Any]) -> dict[str, Any]:
        """``[sweep]`` with each axis that is a parameter as a list of all its values, for the file's own checks."""
        sweep = dict(data["sweep"])
        for place, parameter in enumerate(self.parameters):
            if parameter.name in AXES:
                sweep[parameter.name] = sorted({float(point[place]) for point in self.points})
        return sweep
