"""What a truth is: one way in which a device or its bench may be wrong, which belongs to exactly one set."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.device.parts import Actuator
from femfit.trial.device import Conditions, Device, HiddenError

Group = Literal["catalogue", "drawing", "when", "unseen"]
"""An effect of the catalogue by other physics; a number of the drawing; an effect that begins or ends in the campaign;
a cause that no catalogue has."""

Build = Callable[[Device, np.random.Generator], HiddenError]

FIELD = ("force_N", "flux_linkage_Wb", "hall_V")
BY_CURRENT = ("flux_linkage_Wb", "voltage_V", "force_N")

BEND = 0.1
"""How far the form of an error departs from its definition, over its size: no bench is as simple as a definition."""

Bend = Callable[[FloatArray], FloatArray]

BENDS: Mapping[str, Bend] = {
    "even": np.abs,
    "odd": lambda x: x,
    "wave": lambda x: np.asarray(np.cos(np.pi * x)),
}
"""How the forms depart, over -1 to 1 of a range: one for each set."""


def _nothing(actuator: Actuator) -> str:
    del actuator
    return ""


def _no_families(actuator: Actuator) -> Mapping[str, Mapping[float, Actuator]]:
    del actuator
    return {}


@dataclass(frozen=True)
class Truth:
    """One way of being wrong."""

    build: Build
    group: Group = "catalogue"
    lacks: Callable[[Actuator], str] = _nothing  # What the drawing lacks to show it; empty for nothing
    # Changed drawings by family and the number p of the change, which are solved for it
    families: Callable[[Actuator], Mapping[str, Mapping[float, Actuator]]] = _no_families


def no_hall(actuator: Actuator) -> str:
    """What a drawing without a Hall element lacks."""
    return "" if actuator.hall is not None else "no Hall element"


def bent(x: FloatArray, bend: Bend) -> FloatArray:
    """1 with a bend over -1 to 1 of a range."""
    return 1.0 + BEND * bend(x)


def place(device: Device, at: Conditions) -> FloatArray:
    """Distances between -1 and 1 of the sweep's range."""
    low, high = device.actuator.sweep.distances_m[0], device.actuator.sweep.distances_m[-1]
    return (2.0 * at.distance - low - high) / (high - low)


def moved(at: Conditions, change: FloatArray) -> Conditions:
    """With the body elsewhere by ``change``."""
    return replace(at, distance=at.distance + change)


def driven(at: Conditions, change: FloatArray) -> Conditions:
    """With a current that differs by ``change``."""
    return replace(at, current=at.current + change)
