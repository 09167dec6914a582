"""Every effect that a static bench table can show: its truth, what it needs, and which others look the same."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from femfit.trial.drawing_variants import moves_magnet
from femfit.trial.off_axis import has_one_core
from support.trial_study.truth import hidden_bench as bench
from support.trial_study.truth import hidden_magnetics as magnetics
from support.trial_study.truth import hidden_sensor as sensor
from support.trial_study.truth.bench import Hidden
from support.trial_study.truth.families import Truth

Build = Callable[[Truth, np.random.Generator], Hidden]
"""Signature of every hidden truth: (actuator's field solutions, randomness for its shape) -> what is hidden."""


@dataclass(frozen=True)
class Entry:
    """An effect of the trial.

    Parameters
    ----------
    channels : tuple of str
        Of which a campaign must have at least one.
    along : tuple of str
        Columns with which its misfit changes by its physics: a right answer to "along what" names one of them; empty
        where it is the same everywhere.
    family : str
        Field solutions it needs; empty for none but the drawing's.
    column : str
        A column that must be recorded for it to be known.
    """

    build: Build
    channels: tuple[str, ...]
    along: tuple[str, ...]
    family: str = ""
    column: str = ""


_ALL = ("force_N", "flux_linkage_Wb", "hall_V")
_FIELD = ("force_N", "flux_linkage_Wb")
_D, _I = "distance_m", "current_A"

BENCH_EFFECTS: Mapping[str, Entry] = {
    "core_saturation": Entry(magnetics.core_saturation, _FIELD, (_D, _I), "saturation-1"),
    "hysteresis": Entry(magnetics.hysteresis, _ALL, ("branch",), "memory", "branch"),
    "magnet_temperature": Entry(
        magnetics.magnet_temperature, _ALL, ("magnet_temperature_C",), "magnets", "magnet_temperature_C"
    ),
    "magnet_demagnetisation": Entry(magnetics.magnet_demagnetisation, _ALL, (_D,), "layer"),
    "position_dependent_inductance": Entry(magnetics.position_dependent_inductance, _FIELD, (_D, _I), "ring"),
    "lateral_misalignment": Entry(magnetics.lateral_misalignment, _ALL, (_D,)),
    "external_field": Entry(magnetics.external_field, ("hall_V",), (_D, _I), "core"),
    "coil_temperature": Entry(
        bench.coil_temperature, ("voltage_V",), ("coil_temperature_C", _I), column="coil_temperature_C"
    ),
    "end_stop_contact": Entry(bench.end_stop_contact, ("force_N",), (_D,)),
    "constant_force": Entry(bench.constant_force, ("force_N",), ()),
    "force_offset": Entry(bench.force_offset, ("force_N",), ()),
    "force_gain": Entry(bench.force_gain, ("force_N",), (_D, _I)),
    "distance_offset": Entry(bench.distance_offset, ("force_N",), (_D,)),
    "distance_scale": Entry(bench.distance_scale, ("force_N",), (_D,)),
    "current_gain": Entry(bench.current_gain, ("flux_linkage_Wb", "voltage_V", "force_N"), (_I,)),
    "current_offset": Entry(bench.current_offset, ("flux_linkage_Wb", "voltage_V", "force_N"), (_D, _I)),
    "flux_integrator_drift": Entry(bench.flux_integrator_drift, ("flux_linkage_Wb",), ("order", "elapsed")),
    "hall_offset": Entry(sensor.hall_offset, ("hall_V",), ()),
    "hall_drift": Entry(sensor.hall_drift, ("hall_V",), ("elapsed", "order")),
    "hall_temperature": Entry(
        sensor.hall_temperature,
        ("hall_V",),
        ("coil_temperature_C", "magnet_temperature_C"),
        column="coil_temperature_C",
    ),
    "hall_saturation": Entry(sensor.hall_saturation, ("hall_V",), (_D, _I)),
    "hall_coil_pickup": Entry(sensor.hall_coil_pickup, ("hall_V",), (_I,)),
}
"""By name. What a static bench cannot show (lag, friction, mass, back-EMF, delay, a driver's gain) is not here."""

TWINS: tuple[frozenset[str], ...] = (frozenset({"constant_force", "force_offset"}),)
"""Effects that no static bench tells apart, whatever it measures: withheld together."""


def twins_of(name: str) -> tuple[str, ...]:
    """An effect and those that do the same to every channel of a bench."""
    others = set().union(*(group for group in TWINS if name in group)) - {name}
    return (name, *sorted(others))


def possible_effects(truth: Truth) -> list[str]:
    """The effects that an actuator can have."""
    result = []
    for name, entry in BENCH_EFFECTS.items():
        if entry.family and entry.family not in truth.families:
            continue
        if entry.channels == ("hall_V",) and truth.actuator.hall is None:
            continue
        if name == "lateral_misalignment" and not _may_stand_beside(truth):
            continue
        result.append(name)
    return result


def _may_stand_beside(truth: Truth) -> bool:
    """Whether the body has a truth of its sideways offset: a plunger's bore, or a magnet below one core."""
    return "bore" in truth.families or (moves_magnet(truth.actuator) and has_one_core(truth.actuator))
