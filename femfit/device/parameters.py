"""What a file sweeps: currents, distances and frequencies, and the points of ``[sweep.parameters]``.

A grid is a key of the sweep table; it must come out the same on every machine and in every language.

References
----------
M. D. McKay, R. J. Beckman and W. J. Conover, Technometrics 21 (1979) 239: Latin hypercube sampling.
"""

import re
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np

from femfit.device.complaints import complain, did_you_mean, given_by, joined, read_value
from femfit.device.drawing import is_winding, part_tables
from femfit.device.file_numbers import Location, with_value
from femfit.device.keys import SI_UNITS, RangeEntry, decimal_sum, keys_of, scaled, unit_of
from femfit.device.schema import SampledEntry, SolverEntry, SweepEntry

MIN_DISTANCE = 1e-3
"""In mm, of schema 1: a micrometre is less than a face is flat, and still a gap that can be meshed."""

CURRENT = keys_of(SweepEntry)["current_A"]


def read_axes(
    data: Mapping[str, Any], circuits: Sequence[str], problems: list[str]
) -> tuple[list[tuple[float, ...]], tuple[float, ...]]:
    """The currents in A of each of these circuits, and the distances in mm; empty where they are unusable."""
    sweep = data.get("sweep")
    if not isinstance(sweep, dict):
        return [], ()
    currents, without = sweep.get("current_A"), not any(is_winding(place) for place, _ in part_tables(data))
    axes, each = [], isinstance(currents, dict) and not currents.keys() <= keys_of(RangeEntry).keys()
    shared = {key: value for key, value in sweep.items() if key != "current_A" or not (each or without)}
    entry = given_by(SweepEntry, shared, "sweep", problems)
    if isinstance(currents, dict) and each:
        axes = _by_circuit(currents, circuits, problems)
    elif currents is None and not without:
        complain(problems, "missing", "sweep.current_A", remedy=CURRENT.remedy)
    elif not without:
        if len(circuits) > 1:
            first, second, *_ = circuits
            complain(problems, "each_current", known=", ".join(circuits), first=first, second=second)
        axes = [tuple(entry.current_A or ())]
    distances_mm = () if "distance_mm" in entry.wrong else tuple(entry.distance_mm)
    if distances_mm and distances_mm[0] < MIN_DISTANCE and data.get("schema") == 1:
        complain(problems, "no_gap", start=distances_mm[0], least=MIN_DISTANCE)
    return axes, distances_mm


def _by_circuit(currents: Mapping[str, Any], circuits: Sequence[str], problems: list[str]) -> list[tuple[float, ...]]:
    paths = {name: joined("sweep.current_A", name) for name in (*currents, *circuits)}
    for name in (name for name in currents if name not in circuits):
        near, known = did_you_mean(name, circuits), ", ".join(circuits) or "none"
        complain(problems, "not_a_circuit", paths[name], near=near, known=known)
    for name in (name for name in circuits if name not in currents):
        complain(problems, "missing", paths[name], remedy="Give the circuit's currents.")
    swept = (name for name in circuits if name in currents)
    return [tuple(read_value(CURRENT, currents[name], paths[name], problems) or ()) for name in swept]


def eddy_bias(entry: SolverEntry | None, circuits: int, problems: list[str]) -> tuple[float, ...]:
    """The currents in A about which eddy currents are linearised; empty where the file gives none."""
    bias = entry.eddy_bias_A if entry is not None else None
    if bias is None:
        return ()
    values = bias if isinstance(bias, tuple) else (bias,)
    if len(values) != circuits:
        complain(problems, "eddy_bias", circuits=circuits, count=len(values))
    return values


Value = float | str
"""Value of a parameter: a number, or the name of a material."""

Points = tuple[tuple[Value, ...], ...]
"""One tuple a point, one value a parameter."""

Values = Sequence[float] | Sequence[str] | SampledEntry
"""Those of one parameter, or the range that they are drawn from."""


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
    values: Values

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
        tables["sweep"] = {key: value for key, value in tables["sweep"].items() if key in ("current_A", "distance_mm")}
        for parameter, value in zip(self.parameters, point, strict=True):
            for key in parameter.keys:
                number = value if isinstance(value, str) else decimal_sum(key.offset, key.factor, value)
                with_value(tables, key.location, number)
        return tables
