"""Three disjoint sets of truths: to calibrate a decision, to develop it, and for the final table.

Each truth belongs to one set. The effects of the catalogue are in all three, realised by other physics or settings in
each; the numbers of a drawing are dealt out to them.
"""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.device.load import read_actuator
from femfit.trial.field_table import is_linear
from femfit.trial.truths import course, hall, magnetics, mechanics, memory, sideways, warmth
from femfit.trial.truths.drawing_numbers import number_truths
from femfit.trial.truths.meters import meter_errors
from femfit.trial.truths.truth import BENDS, Truth

SetName = Literal["calibration", "development", "final"]

SETS: tuple[SetName, ...] = ("calibration", "development", "final")

_LINEAR_NUMBERS, _SATURATING_NUMBERS = 5, 2
"""Numbers of the drawing in each set: a saturating sweep takes ten times as long."""

_WARMTH: tuple[warmth.Law, ...] = ("thermometer", "hot inside", "late")
_MAGNETS: tuple[Literal["scaled", "grade", "shell"], ...] = ("scaled", "grade", "shell")
_DRIFT: tuple[Literal["line", "settling", "walk"], ...] = ("line", "settling", "walk")


def _froehlich(x: FloatArray) -> FloatArray:
    return x / (1.0 + x)


def _sharp(x: FloatArray) -> FloatArray:
    return np.asarray(x / (1.0 + x**2.5) ** 0.4)


def _arctangent(x: FloatArray) -> FloatArray:
    return np.asarray(2.0 / np.pi * np.arctan(0.5 * np.pi * x))


_SATURATION = (_froehlich, _sharp, _arctangent)

_ONE_OF: Mapping[str, Callable[[int], Truth]] = {
    "turns": lambda k: magnetics.lost_turns(("everywhere", "outside", "end")[k]),
    "remanence": lambda k: magnetics.weaker_magnets(_MAGNETS[k]),
    "magnet_demagnetisation": lambda k: magnetics.demagnetised(("face", "back", "rim")[k]),
    "core_saturation": lambda k: magnetics.saturating(("first", "second", "third")[k], _SATURATION[k]),
    "hysteresis": lambda k: memory.hysteresis(("normal relays", "jiles-atherton", "lorentzian relays")[k]),
    "core_remanence": lambda k: memory.kept_flux(tuple(BENDS.values())[k]),
    "coil_temperature": lambda k: warmth.winding(_WARMTH[k]),
    "magnet_temperature": lambda k: warmth.magnets(
        f"remanence-{_MAGNETS[k]}", partial(magnetics.remanence_drawings, how=_MAGNETS[k]), _WARMTH[k]
    ),
    "hall_temperature": lambda k: warmth.hall_element(_WARMTH[k]),
    "hall_saturation": lambda k: hall.hall_saturation(("tanh", "power", "knee")[k]),
    "hall_drift": lambda k: course.drift("hall_V", _DRIFT[k]),
    "flux_integrator_drift": lambda k: course.integrator(("square", "no reset", "leaky")[k]),
    "lateral_misalignment": lambda k: sideways.beside_the_axis(("everywhere", "by mount", "tilted")[k]),
    "end_stop_contact": lambda k: mechanics.stop(("ball", "flat", "rubber")[k]),
    "spring": lambda k: mechanics.spring(("straight", "conical", "pretensioned")[k]),
    "spring_in_force": lambda k: mechanics.carried_spring(tuple(BENDS.values())[k]),
    "force_drift": lambda k: course.drift("force_N", _DRIFT[k]),
    "load_cell_warmth": lambda k: warmth.load_cell(("zero", "span", "both")[k]),
    "linkage_friction": lambda k: mechanics.friction(("coulomb", "stribeck", "lugre")[k]),
    "screw": lambda k: mechanics.screw(("sine", "saw", "two gears")[k]),
}
"""By the effect, or the cause: its realisation in the set of a number."""

_IN_SOME_RUNS: Mapping[SetName, tuple[course.Shape, tuple[str, ...]]] = {
    "calibration": ("begins", ("remanence", "resistance", "force_gain", "hall_offset", "distance_offset")),
    "development": ("ends", ("turns", "force_offset", "current_gain", "hall_coil_pickup", "lateral_misalignment")),
    "final": ("interval", ("remanence", "current_offset", "force_gain", "hall_offset", "resistance", "force_offset")),
}
"""How errors come and go in each set, and which."""


def truths_of(drawing: Path, part: SetName) -> dict[str, Truth]:
    """The truths of a set for a drawing, by names that no other set has; also those that it cannot show."""
    k = SETS.index(part)
    bend = tuple(BENDS)[k]
    basic = dict(meter_errors(BENDS[bend])) | {name: one(k) for name, one in _ONE_OF.items()}
    if part == "development":
        basic["external_field"] = magnetics.outer_field()
    shape, stepping = _IN_SOME_RUNS[part]
    for name in stepping:
        basic[f"{name} {shape}"] = course.only_in_some_runs(basic[name], name, shape)
    count = _LINEAR_NUMBERS if is_linear(read_actuator(drawing)) else _SATURATING_NUMBERS
    numbers = number_truths(drawing, k, len(SETS), count)
    return {f"{name} ({part})": truth for name, truth in (basic | dict(numbers)).items()}
