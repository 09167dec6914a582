"""A device on a virtual bench: its solved fields, what can be wrong with it, and what its sensors would then read."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from femfit.core.numerics import FloatArray, IntArray
from femfit.device.parts import Actuator
from femfit.trial.field_table import Fields, FieldTable


@dataclass(frozen=True, eq=False)
class Conditions:
    """Settings of n readings, in the order of measuring: m, A, s since the start of the run, degC."""

    distance: FloatArray
    current: FloatArray
    time_s: FloatArray
    coil_C: FloatArray
    magnet_C: FloatArray
    run: IntArray  # From 0
    campaign_s: FloatArray  # Since the start of the campaign


@dataclass(frozen=True, eq=False)
class Family:
    """Fields of a drawing as a function of one number p, which is 0 where nothing is changed."""

    values: tuple[float, ...]  # Of p, one a solution; never 0
    tables: tuple[FieldTable, ...]
    reference: FieldTable  # At p = 0

    def change(self, p: FloatArray | float, distance: FloatArray, current: FloatArray) -> Fields:
        """The fields at p less those at 0, by the polynomial through the solutions; p may be one number a point."""
        base = self.reference.at(distance, current)
        total = base.times(0.0)
        for k, (value, table) in enumerate(zip(self.values, self.tables, strict=True)):
            weight = np.asarray(1.0)
            for node in (0.0, *self.values[:k], *self.values[k + 1 :]):
                weight = weight * (p - node) / (value - node)
            total += (table.at(distance, current) - base).times(weight)
        return total


@dataclass(frozen=True, eq=False)
class Device:
    """A drawing's fields, and those of its changed forms."""

    actuator: Actuator
    drawn: FieldTable
    families: Mapping[str, Family]

    def change(self, family: str, p: FloatArray | float, settings: Conditions) -> Fields:
        """What the change of a family adds to the drawn fields."""
        return self.families[family].change(p, settings.distance, settings.current)

    def with_turns(self, change: float, settings: Conditions) -> Fields:
        """What 1 + change times the turns add to the drawn fields: they are those of as much more current."""
        more = self.drawn.at(settings.distance, (1.0 + change) * settings.current)
        more = replace(more, flux_linkage=(1.0 + change) * more.flux_linkage)
        return more - self.drawn.at(settings.distance, settings.current)

    @property
    def largest_current(self) -> float:
        """Of the sweep, in A."""
        return max(map(abs, self.actuator.sweep.currents_A))

    @property
    def largest_force(self) -> float:
        """At the smallest distance and the last current of the sweep, in N."""
        near, most = self.actuator.sweep.distances_m[0], self.actuator.sweep.currents_A[-1]
        return float(np.abs(self.drawn.at(np.array([near]), np.array([most])).force)[0])

    @property
    def largest_shift(self) -> float:
        """Largest error of a stage's zero that is believable, in m."""
        low, high = self.drawn.distances
        if low <= 0.0:  # no distance is near: the margin of the solved fields
            return 0.02 * (high - low)
        return min(1e-3, 0.15 * low + 0.01 * (high - low))


Readings = Mapping[str, FloatArray]


@dataclass(frozen=True)
class HiddenError:
    """One thing that is wrong, up to its size."""

    limit: Callable[[Device], float]  # Takes the device; the largest size that is still believable
    channels: tuple[str, ...]  # Those that show it, of which a campaign records at least one
    needs: str = ""  # What the drawing must have; empty for nothing
    setting: Callable[[Device, float, Conditions], Conditions] | None = None
    fields: Callable[[Device, float, Conditions], Fields] | None = None
    reading: Callable[[Device, float, Conditions, Readings], Readings] | None = None
    names: tuple[str, ...] | None = None  # Of the diagnosis that are right; None: what it is called here


def true_readings(
    device: Device, settings: Conditions, hidden: Mapping[str, float], errors: Mapping[str, HiddenError]
) -> dict[str, FloatArray]:
    """What the sensors would read without noise; hidden errors by name, with their sizes."""
    wrong = [(errors[name], size) for name, size in hidden.items()]
    for error, size in wrong:
        settings = error.setting(device, size, settings) if error.setting else settings
    fields = device.drawn.at(settings.distance, settings.current)
    for error, size in wrong:
        fields = fields + error.fields(device, size, settings) if error.fields else fields
    values = {
        "force_N": fields.force,
        "flux_linkage_Wb": fields.flux_linkage,
        "voltage_V": device.actuator.coil.resistance_ohm * settings.current,
    }
    if device.actuator.hall is not None:
        values["hall_V"] = device.actuator.hall.quiescent_V + device.actuator.hall.sensitivity_V_per_T * fields.hall
    for error, size in wrong:
        values |= error.reading(device, size, settings, values) if error.reading else {}
    return values
