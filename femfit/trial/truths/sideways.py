"""A moving part beside the axis: a magnet by integrals over its displaced faces, a plunger by its eccentric gap.

What the core and the winding do to a displaced magnet is solved in three dimensions (:mod:`femfit.trial.off_axis`) at
four offsets; between them the change over the squared offset is a polynomial of it.
"""

from collections.abc import Mapping
from typing import Literal

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import MissingPartError
from femfit.device.parts import Actuator
from femfit.trial.device import Conditions, Device, HiddenError
from femfit.trial.drawing_variants import eccentric_bore, is_magnet, is_soft, moves_magnet, plunger_bore
from femfit.trial.field_table import Fields
from femfit.trial.off_axis import displaced, has_one_core
from femfit.trial.truths.magnetics import is_rectangle
from femfit.trial.truths.truth import FIELD, Truth

_NODES = (0.25, 0.5, 0.75, 1.0)
_BORE_NODES = (0.5, 0.8)
"""Eccentricities that are solved, over the clearance."""

Course = Literal["everywhere", "by mount", "tilted"]


def beside_the_axis(course: Course) -> Truth:
    """The same offset throughout, another one with each run, or one that grows with the distance: a tilted guide."""

    def build(device: Device, rng: np.random.Generator) -> HiddenError:
        shares = rng.uniform(0.3, 1.0, 32)

        def offset(size: float, at: Conditions) -> FloatArray:
            far = device.actuator.sweep.distances_m[-1]
            share = {"everywhere": np.ones(len(at.run)), "by mount": shares[at.run % 32], "tilted": at.distance / far}
            return abs(size) * share[course]

        plunger = "bore" in device.families
        limit = _clearance(device.actuator) * 0.8 if plunger else 0.5 * _magnet_radius(device.actuator)

        def fields(device: Device, size: float, at: Conditions) -> Fields:
            if plunger:
                return device.change("bore", offset(size, at) ** 2, at)
            return magnet_beside(device, offset(size, at), limit, at)

        return HiddenError(lambda _: limit / 1.1, FIELD, fields=fields, names=("lateral_misalignment",))

    return Truth(build, lacks=_lacks, families=_drawings)


def magnet_beside(device: Device, offset: FloatArray, largest: float, at: Conditions) -> Fields:
    """What the offset of a magnet, one a reading and up to ``largest`` in m, adds to the fields on the axis."""
    nodes = [largest * node for node in _NODES]
    solved = [displaced(device.actuator, node, device.drawn.distances) for node in nodes]
    squared = np.array([node**2 for node in nodes])

    def change(name: str) -> FloatArray:
        """Of a ratio, by the polynomial in the squared offset."""
        values = [np.interp(np.log(at.distance), one.log_distance, getattr(one, name)) for one in solved]
        total = np.zeros(len(offset))
        for k, value in enumerate(values):
            others = np.delete(squared, k)
            total += value * np.prod([(offset**2 - x) / (squared[k] - x) for x in others], axis=0)
        return offset**2 * total

    zero = np.zeros_like(at.current)
    passive = device.drawn.at(at.distance, zero)
    ahead, back = device.drawn.at(at.distance, at.current), device.drawn.at(at.distance, -at.current)
    return Fields(
        change("passive") * passive.force + change("coil") * 0.5 * (ahead.force - back.force),
        change("flux") * passive.flux_linkage,
        change("hall") * passive.hall,
    )


def _lacks(actuator: Actuator) -> str:
    if _has_bore(actuator):
        return ""
    magnets = [one for one in actuator.moving.regions if is_magnet(one)]
    if not moves_magnet(actuator) or not all(is_rectangle(one.vertices_m) for one in magnets):
        return "no moving magnet drawn as a rectangle, and no plunger in a bore"
    if any(map(is_magnet, actuator.fixed)) or not any(map(is_soft, actuator.fixed)) or not has_one_core(actuator):
        return "no single core that the displaced magnet could be solved with"
    return "" if min(actuator.sweep.distances_m) > 0.0 else "no distance from the core"


def _has_bore(actuator: Actuator) -> bool:
    try:
        plunger_bore(actuator)
    except MissingPartError:
        return False
    return True


def _clearance(actuator: Actuator) -> float:
    _, bore, plunger = plunger_bore(actuator)
    return bore - plunger


def _magnet_radius(actuator: Actuator) -> float:
    return max(float(r) for one in actuator.moving.regions if is_magnet(one) for r, _ in one.vertices_m)


def _drawings(actuator: Actuator) -> Mapping[str, Mapping[float, Actuator]]:
    if not _has_bore(actuator):
        return {}
    offsets = [node * _clearance(actuator) for node in _BORE_NODES]
    return {"bore": {offset**2: eccentric_bore(actuator, offset) for offset in offsets}}
