"""Three disjoint sets of truths: to calibrate a decision, to develop it, and for the final table.

Each truth belongs to one set. The effects of the catalogue are in all three, realised by other physics or settings in
each; the numbers of a drawing are dealt out to them.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from femfit.core.errors import FieldSolverError
from femfit.device.load import read_actuator
from femfit.trial.field_table import Device, Family, solve_drawings
from support.trial import magnetics, mechanics, memory, off_axis, readings
from support.trial.drawing_numbers import number_truths
from support.trial.truth import BENDS, Shape, Truth, only_in_some_runs

SetName = Literal["calibration", "development", "final"]

SETS: tuple[SetName, ...] = ("calibration", "development", "final")

_LINEAR_NUMBERS, _SATURATING_NUMBERS = 5, 2
"""Numbers of the drawing in each set: a saturating sweep takes ten times as long."""

_WARMTH = ("thermometer", "hot inside", "late")
_MAGNETS = ("scaled", "grade", "shell")
_DRIFT = ("line", "settling", "walk")
_SATURATION = (
    lambda x: x / (1.0 + x),  # Froehlich and Kennelly
    lambda x: x / (1.0 + x**2.5) ** 0.4,
    lambda x: 2.0 / np.pi * np.arctan(0.5 * np.pi * x),
)

_TRUTHS: Mapping[str, Callable[[int], Truth]] = {
    "turns": lambda k: magnetics.lost_turns(("everywhere", "outside", "end")[k]),
    "remanence": lambda k: magnetics.weaker_magnets(_MAGNETS[k]),
    "magnet_demagnetisation": lambda k: magnetics.demagnetised(("face", "back", "rim")[k]),
    "core_saturation": lambda k: magnetics.saturating(("first", "second", "third")[k], _SATURATION[k]),
    "hysteresis": lambda k: memory.hysteresis(("normal relays", "jiles-atherton", "lorentzian relays")[k]),
    "core_remanence": lambda k: memory.kept_flux(tuple(BENDS.values())[k]),
    "coil_temperature": lambda k: readings.winding(_WARMTH[k]),
    "magnet_temperature": lambda k: readings.magnets(
        f"remanence-{_MAGNETS[k]}", partial(magnetics.remanence_drawings, how=_MAGNETS[k]), _WARMTH[k]
    ),
    "hall_temperature": lambda k: readings.hall_element(_WARMTH[k]),
    "hall_saturation": lambda k: readings.hall_saturation(("tanh", "power", "knee")[k]),
    "hall_drift": lambda k: readings.drift("hall_V", _DRIFT[k]),
    "flux_integrator_drift": lambda k: readings.integrator(("square", "no reset", "leaky")[k]),
    "lateral_misalignment": lambda k: off_axis.beside_the_axis(("everywhere", "by mount", "tilted")[k]),
    "end_stop_contact": lambda k: mechanics.stop(("ball", "flat", "rubber")[k]),
    "spring": lambda k: mechanics.spring(("straight", "conical", "pretensioned")[k]),
    "spring_in_force": lambda k: mechanics.carried_spring(tuple(BENDS.values())[k]),
    "force_drift": lambda k: readings.drift("force_N", _DRIFT[k]),
    "load_cell_warmth": lambda k: readings.load_cell(("zero", "span", "both")[k]),
    "linkage_friction": lambda k: mechanics.friction(("coulomb", "stribeck", "lugre")[k]),
    "screw": lambda k: mechanics.screw(("sine", "saw", "two gears")[k]),
}
"""By the effect, or the cause: its realisation in the set of a number."""

_IN_SOME_RUNS: Mapping[SetName, tuple[Shape, tuple[str, ...]]] = {
    "calibration": ("begins", ("remanence", "resistance", "force_gain", "hall_offset", "distance_offset")),
    "development": ("ends", ("turns", "force_offset", "current_gain", "hall_coil_pickup", "lateral_misalignment")),
    "final": ("interval", ("remanence", "current_offset", "force_gain", "hall_offset", "resistance", "force_offset")),
}
"""How errors come and go in each set, and which."""


def truths_of(drawing: Path, set_name: SetName) -> dict[str, Truth]:
    """The truths of a set for a drawing, by names that no other set has; also those that it cannot show."""
    k = SETS.index(set_name)
    truths = dict(readings.meter_errors(tuple(BENDS.values())[k])) | {name: make(k) for name, make in _TRUTHS.items()}
    if set_name == "development":
        truths["external_field"] = magnetics.outer_field()
    shape, passing = _IN_SOME_RUNS[set_name]
    for name in passing:
        truths[f"{name} {shape}"] = only_in_some_runs(truths[name], name, shape)
    count = _SATURATING_NUMBERS if read_actuator(drawing).saturates else _LINEAR_NUMBERS
    truths |= number_truths(drawing, k, len(SETS), count)
    return {f"{name} ({set_name})": truth for name, truth in truths.items()}


@dataclass(frozen=True)
class TruthSet:
    """The truths of a set that a device can show, and why it cannot show the others."""

    name: SetName
    truths: Mapping[str, Truth]
    left_out: Mapping[str, str] = field(default_factory=dict)

    def reasons(self) -> dict[str, list[str]]:
        """What is left out, by the reason, in short names."""
        names: dict[str, list[str]] = {}
        for name, reason in self.left_out.items():
            names.setdefault(reason, []).append(name.partition(" (")[0])
        return names


def prepare_set(drawing: Path, device: Device, directory: Path, set_name: SetName, *, workers: int, progress=None):
    """Solve the changed drawings of a set's truths; the device with their fields, and the truths that it can show."""
    families, possible, left_out = dict(device.families), {}, {}
    for name, truth in truths_of(drawing, set_name).items():
        reason = truth.lacks(device.actuator)
        try:
            for family, forms in () if reason else truth.families(device.actuator).items():
                if family not in families:
                    subdirectory = directory / "truths" / re.sub(r"[^\w.-]+", "_", family)
                    drawings = {f"{change:+.6g}": form for change, form in forms.items()}
                    tables = solve_drawings(drawings, subdirectory, workers=workers, progress=progress)
                    families[family] = Family(tuple(forms), tuple(tables.values()), device.drawn)
        except FieldSolverError as error:
            reason = str(error)
        if reason:
            left_out[name] = reason
        else:
            possible[name] = truth
    return replace(device, families=families), TruthSet(set_name, possible, left_out)
