"""What a truth is: one way in which a device or its bench may be wrong, which belongs to exactly one set."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from femfit.trial.field_table import HiddenError
from femfit.trial.hidden import is_magnet

GROUPS = ("catalogue", "drawing", "when", "unseen")
"""An effect by other physics; a number of the drawing; an error of some runs; a cause that no catalogue has."""

FIELD = ("force_N", "flux_linkage_Wb", "hall_V")
BY_CURRENT = ("flux_linkage_Wb", "voltage_V", "force_N")

BEND = 0.1
"""How far the form of an error departs from its definition, over its size: no bench is as simple as a definition."""

BENDS = {"even": np.abs, "odd": lambda x: x, "wave": lambda x: np.asarray(np.cos(np.pi * x))}
"""How the forms depart, over -1 to 1 of a range: one for each set."""


@dataclass(frozen=True)
class PassingError(HiddenError):
    """An error that does not act in all runs; of one run it acts in all."""

    course: Callable[[int], tuple[int, int]] | None = None  # Of the number of runs: the first and last, from 1


@dataclass(frozen=True)
class Truth:
    """One way of being wrong; it is built for a device with a random generator."""

    build: Callable
    group: str = "catalogue"
    lacks: Callable = lambda drawn: ""  # What the drawing lacks to show it; empty for nothing
    families: Callable = lambda drawn: {}  # Changed drawings, which are solved, by family and number p of the change


def always(error, group="catalogue", **more):
    """A truth that is the same in every campaign."""
    return Truth(lambda device, rng: error, group, **more)


def needing(what, test):
    """What a drawing lacks that does not pass a test."""
    return lambda drawn: "" if test(drawn) else f"no {what}"


needing_hall = needing("Hall element", lambda drawn: drawn.hall is not None)
needing_magnet = needing("magnet", lambda drawn: any(map(is_magnet, drawn.regions)))


def of_reading(channel, limit, form, *, one_way=False, names=None):
    """An error that adds its size, or the magnitude of that, times ``form(device, settings, values)`` to a channel."""

    sized, largest = abs if one_way else float, limit if callable(limit) else lambda _: limit

    def reading(device, size, settings, values):
        return {channel: values[channel] + sized(size) * form(device, settings, values)}

    return HiddenError(largest, (channel,), reading=reading, names=names)


def of_family(family, limit, channels=FIELD, *, one_way=True, names=None):
    """An error that is solved as the change of a family of drawings."""

    sized = abs if one_way else float

    def fields(device, size, settings):
        return device.change(family, sized(size), settings)

    return HiddenError(lambda _: limit, channels, fields=fields, names=names)


def of_force(share):
    """A limit in parts of the largest force."""
    return lambda device: share * device.largest_force


def bent(x, bend):
    """1 with a bend over -1 to 1 of a range."""
    return 1.0 + BEND * bend(x)


def travel(device):
    """First and last distance of the sweep."""
    return device.actuator.sweep.distances_m[0], device.actuator.sweep.distances_m[-1]


def place(device, settings):
    """Distances between -1 and 1 of the sweep's range."""
    low, high = travel(device)
    return (2.0 * settings.distance - low - high) / (high - low)


def only_in_some_runs(truth, name, shape):
    """A truth that begins at a run, ends before one, or acts from one to another."""

    def build(device, rng):
        error, share, length = truth.build(device, rng), float(rng.uniform()), float(rng.uniform())
        course = partial(_acting, shape, share, length)

        def acts(settings):
            first, last = course(int(settings.run.max()) + 1)
            return (settings.run + 1 >= first) & (settings.run + 1 <= last)

        def setting(device, size, settings):
            changed, acting = error.setting(device, size, settings), acts(settings)
            distance = np.where(acting, changed.distance, settings.distance)
            return replace(settings, distance=distance, current=np.where(acting, changed.current, settings.current))

        def fields(device, size, settings):
            return error.fields(device, size, settings) * acts(settings)

        def reading(device, size, settings, values):
            changed = error.reading(device, size, settings, values)
            return {name: np.where(acts(settings), value, values[name]) for name, value in changed.items()}

        stages = {"setting": setting, "fields": fields, "reading": reading}
        acting_stages = {stage: getattr(error, stage) and function for stage, function in stages.items()}
        names = (name,) if error.names is None else error.names
        return PassingError(error.limit, error.channels, names=names, course=course, **acting_stages)

    return Truth(build, "when", truth.lacks, truth.families)


def _acting(shape, share, length, runs):
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
