"""What a truth is: one way in which a device or its bench may be wrong, which belongs to exactly one set."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.device.parts import Actuator
from femfit.trial.field_table import Conditions, Device, HiddenError

Group = Literal["catalogue", "drawing", "when", "unseen"]
"""An effect of the catalogue by other physics; a number of the drawing; an effect that begins or ends in the campaign;
a cause that no catalogue has."""

Build = Callable[[Device, np.random.Generator], HiddenError]
Drawings = Mapping[str, Mapping[float, Actuator]]
"""Changed drawings by family and the number p of the change."""

FIELD = ("force_N", "flux_linkage_Wb", "hall_V")
BY_CURRENT = ("flux_linkage_Wb", "voltage_V", "force_N")

BEND = 0.1
"""How far the form of an error departs from its definition, over its size: no bench is as simple as a definition."""

Bend = Callable[[FloatArray], FloatArray]

BENDS: Mapping[str, Bend] = {"even": np.abs, "odd": lambda x: x, "wave": lambda x: np.asarray(np.cos(np.pi * x))}
"""How the forms depart, over -1 to 1 of a range: one for each set."""


@dataclass(frozen=True)
class PassingError(HiddenError):
    """An error that does not act in all runs; of one run it acts in all."""

    whole: HiddenError | None = None
    course: Callable[[int], tuple[int, int]] | None = None  # Of the number of runs: the first and last, from 1


@dataclass(frozen=True)
class Truth:
    """One way of being wrong."""

    build: Build
    group: Group = "catalogue"
    lacks: Callable[[Actuator], str] = lambda actuator: ""  # What the drawing lacks to show it; empty for nothing
    families: Callable[[Actuator], Drawings] = lambda actuator: {}  # Changed drawings, which are solved for it


def always(error: HiddenError, group: Group = "catalogue", **more) -> Truth:
    """A truth that is the same in every campaign."""
    return Truth(lambda device, rng: error, group, **more)


def of_reading(channel: str, limit, form, *, one_way=False, names=None) -> HiddenError:
    """An error that adds its size, or the magnitude of that, times ``form(device, settings, values)`` to a channel."""

    def reading(device, size, settings, values):
        size = abs(size) if one_way else size
        return {channel: values[channel] + size * form(device, settings, values)}

    return HiddenError(limit if callable(limit) else lambda _: limit, (channel,), reading=reading, names=names)


def of_force(share: float) -> Callable[[Device], float]:
    """A limit in parts of the largest force."""
    return lambda device: share * device.largest_force


def no_hall(actuator: Actuator) -> str:
    """What a drawing without a Hall element lacks."""
    return "" if actuator.hall is not None else "no Hall element"


def bent(x: FloatArray, bend: Bend) -> FloatArray:
    """1 with a bend over -1 to 1 of a range."""
    return 1.0 + BEND * bend(x)


def place(device: Device, settings: Conditions) -> FloatArray:
    """Distances between -1 and 1 of the sweep's range."""
    low, high = device.actuator.sweep.distances_m[0], device.actuator.sweep.distances_m[-1]
    return (2.0 * settings.distance - low - high) / (high - low)


def moved(settings: Conditions, change: FloatArray) -> Conditions:
    """With the body elsewhere by ``change``."""
    return replace(settings, distance=settings.distance + change)


def driven(settings: Conditions, change: FloatArray) -> Conditions:
    """With a current that differs by ``change``."""
    return replace(settings, current=settings.current + change)


Shape = Literal["begins", "ends", "interval"]


def only_in_some_runs(truth: Truth, name: str, shape: Shape) -> Truth:
    """A truth that begins at a run, ends before one, or acts from one to another."""

    def build(device, rng):
        error, share, length = truth.build(device, rng), float(rng.uniform()), float(rng.uniform())
        named = error if error.names is not None else replace(error, names=(name,))
        return acting_only(named, lambda runs: _acting(shape, runs, share, length))

    return Truth(build, "when", truth.lacks, truth.families)


def _acting(shape: Shape, runs: int, share: float, length: float) -> tuple[int, int]:
    """First and last run, from 1, of at least two runs: the error is away in at least one."""
    if runs < 2:
        return 1, 1
    turn = 1 + int(share * (runs - 1))  # 1 to runs - 1
    if shape == "begins":
        return turn + 1, runs
    if shape == "ends":
        return 1, turn
    first = 1 + int(share * runs)
    last = first + int(length * (runs - first + 1))
    return (first, last) if last - first + 1 < runs else (1, runs - 1)


def acting_only(error: HiddenError, course: Callable[[int], tuple[int, int]]) -> PassingError:
    """An error that is away outside of the runs that ``course`` gives of their number."""

    def acts(settings):
        first, last = course(int(settings.run.max()) + 1)
        return (settings.run + 1 >= first) & (settings.run + 1 <= last)

    def setting(device, size, settings):
        changed = error.setting(device, size, settings)
        current = np.where(acts(settings), changed.current, settings.current)
        return replace(
            settings, distance=np.where(acts(settings), changed.distance, settings.distance), current=current
        )

    def fields(device, size, settings):
        return error.fields(device, size, settings) * acts(settings)

    def reading(device, size, settings, values):
        changed = error.reading(device, size, settings, values)
        return {name: np.where(acts(settings), value, values[name]) for name, value in changed.items()}

    return PassingError(
        error.limit,
        error.channels,
        setting=setting if error.setting else None,
        fields=fields if error.fields else None,
        reading=reading if error.reading else None,
        names=error.names,
        whole=error,
        course=course,
    )
