"""What each effect would do to these readings, to first order."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from femfit.core.numerics import FloatArray, IntArray
from femfit.effects.conditions import Nominal
from femfit.effects.effect import AddedEffect, Effect, EffectParameter
from femfit.effects.friction import REST
from femfit.identify.constants import ROUNDED
from femfit.identify.observations import Observations
from femfit.tables.header import parts_of
from femfit.tables.measurement import CHANNELS

CHANGES_NOTHING = "it changes no reading at these settings"
"""Why an effect cannot be tested that would be seen at other settings."""

_MAGNET_UNKNOWN = (
    "whether there is a magnet is unknown: the model has no drawing and was fitted to no current of zero (fit it with "
    "--actuator)"
)
_APART = "the co-energy of iron that several circuits saturate does not set the magnets' part apart"
_NO_MAGNET_SEEN = "without current the model has neither force nor flux linkage, so it has no magnet"

_Checks = tuple[tuple[Callable[[Nominal], bool], str], ...]
"""What must hold of a device, one after the other, and what is said where it does not."""

_PARTS: Mapping[str, _Checks] = {
    "magnet": (
        (lambda nominal: nominal.magnets_apart, _APART),
        (lambda nominal: nominal.magnet_known, _MAGNET_UNKNOWN),
        (lambda nominal: nominal.has_magnet or not nominal.magnet_drawn, "the drawing has no magnet"),
        (lambda nominal: nominal.has_magnet, _NO_MAGNET_SEEN),
    ),
    "iron": ((lambda nominal: nominal.has_iron, "the drawing has no iron"),),
    "spring": ((lambda nominal: nominal.springs is not None, "the drawing has no spring"),),
    "voltage driver": ((lambda nominal: nominal.voltage_driver, "a current amplifier feeds the winding"),),
    "stop": ((lambda nominal: math.isfinite(min(map(abs, nominal.stops_m))), "the drawing has no stop"),),
    "no spring": (
        (lambda nominal: nominal.springs is None, "the drawing has a spring, whose own errors are looked at"),
    ),
}
"""What an effect may need in the device."""

_CIRCUIT = "current_A", "voltage_V", "flux_linkage_Wb", "inductance_H", "resistance_ohm"
_CALLED = {REST: "a rest on a stop"}
_MEASURED_ON: Mapping[str, _Checks] = {
    **dict.fromkeys(_CIRCUIT, ((lambda nominal: nominal.peak_current_A > 0.0, "the drawing has no coil"),)),
    "hall_V": ((lambda nominal: not math.isnan(nominal.hall_quiescent_V), "the model has no Hall element"),),
}
"""What a channel is measured on."""


@dataclass(frozen=True, eq=False)
class EffectColumns:
    """First-order change of every reading with an effect's amplitudes, at given shape constants."""

    effect: Effect
    amplitudes: tuple[EffectParameter, ...]
    shape: Mapping[str, float]
    columns: FloatArray  # In the readings' units over the amplitudes'; shape (M, k)
    runs: tuple[int, int] | None = None  # First and last run in which it acts; None for all

    @property
    def bounds(self) -> FloatArray:
        """Bounds of the amplitudes, counted from null; shape (2, k)."""
        return np.array([[p.lower - p.null for p in self.amplitudes], [p.upper - p.null for p in self.amplitudes]])

    def in_runs(self, runs: tuple[int, int], run: IntArray) -> "EffectColumns":
        """The same in some runs alone; the run of each reading has the shape (M,)."""
        acts = (run >= runs[0]) & (run <= runs[1])
        return replace(self, columns=self.columns * acts[:, None], runs=runs)

    def parameters(self, amplitude: FloatArray) -> dict[str, float]:
        """Every parameter of the effect for amplitudes counted from null, shape (k,)."""
        values = self.effect.null() | dict(self.shape)
        return values | {p.name: p.null + float(a) for p, a in zip(self.amplitudes, amplitude, strict=True)}


def why_untestable(effect: Effect, observations: Observations) -> str:
    """Why data cannot show an effect; empty where they can."""
    if effect.name in observations.present:
        return "the model has it already"
    nominal = observations.nominal
    why = next(filter(None, (_not_in_device(need, nominal) for need in effect.needs)), "")
    if why:
        return why
    columns = [need for need in effect.needs if need not in _PARTS]
    # The balances of a record show what moves a body as a force sensor would, but nothing of a sensor that is not there
    read = effect.acts_on == ("sensor",)
    lacking = (need for need in columns if not any(_given(name, observations, read) for name in need.split("|")))
    for need in lacking:
        names = [_CALLED.get(name, name) for name in need.replace("~", "").split("|")]
        return f"these data lack {'a varying ' if need.startswith('~') else ''}{' or '.join(names)}"
    return ""


def _not_in_device(need: str, nominal: Nominal) -> str:
    """Why the device cannot have what an effect needs, whatever is measured; empty where it can."""
    reasons = []
    for name in need.split("|"):
        checks = _PARTS.get(name) or _MEASURED_ON.get(name.lstrip("~")) or ()
        reasons.append(next((why for holds, why in checks if not holds(nominal)), ""))
    return reasons[0] if all(reasons) else ""


def _given(name: str, observations: Observations, read: bool) -> bool:
    """Whether a setting was given, and varies where it must; or a channel, by its sensor where it must be read."""
    column, of_circuits = name.lstrip("~"), {parts_of(channel)[0] for channel in observations.channels}
    if read and name in CHANNELS:
        return name in of_circuits
    if column in observations.covariates and name.startswith("~"):
        values = observations.covariates[column].to_numpy()
        return bool(np.isfinite(values).any() and np.nanmax(values) > np.nanmin(values))
    return column in observations.given or column in of_circuits


def effect_columns(effect: Effect, observations: Observations) -> list[EffectColumns]:
    """The columns of an effect, once for each combination of its shape constants.

    Shape constants have their usual value, the lower end and three quarters of their usual range; combinations without
    any effect on these readings are left out.
    """
    constants = [p for p in effect.parameters if p.nonlinear]
    ranges = [(p.null, *p.plausible) for p in constants]  # the usual value first: it stays where readings say nothing
    trials = [tuple(dict.fromkeys((null, low, low + 0.75 * (high - low)))) for null, low, high in ranges]
    grid = [dict(zip((p.name for p in constants), values, strict=True)) for values in product(*trials)]
    variants = [AddedEffect(effect, effect.null() | nonlinear) for nonlinear in grid]
    return [columns for variant in variants for columns in columns_at(variant, observations)]


def columns_at(added: AddedEffect, observations: Observations) -> list[EffectColumns]:
    """The columns of an effect at its own nonlinear parameters; empty where it changes none of these readings."""
    effect, nonlinear = added.effect, {p.name: added.parameters[p.name] for p in added.effect.parameters if p.nonlinear}
    absent = AddedEffect(effect, effect.null() | nonlinear)
    slopes = observations.predicted([absent], [(0, p.name) for p in effect.amplitudes])[:, 1:]
    pairs, least = list(zip(effect.amplitudes, slopes.T, strict=True)), ROUNDED * np.abs(observations.base)
    visible = [(p, column) for p, column in pairs if np.any(np.abs(column) * p.width > least)]
    if not visible:
        return []
    amplitudes, columns = zip(*visible, strict=True)
    return [EffectColumns(effect, tuple(amplitudes), nonlinear, np.stack(columns, axis=1))]


def testable_columns(
    observations: Observations, effects: Sequence[Effect]
) -> tuple[list[EffectColumns], dict[str, str]]:
    """The first-order columns of every effect that readings can show, and why they cannot show the others."""
    every, untestable = list[EffectColumns](), dict[str, str]()
    for effect in effects:
        reason = why_untestable(effect, observations)
        columns = [] if reason else effect_columns(effect, observations)
        if any(not np.isfinite(variant.columns).all() for variant in columns):
            columns, reason = [], "the model lacks the sensor, circuit or mass that it acts on"
        if not columns:
            untestable[effect.name] = reason or CHANGES_NOTHING
        every += columns
    return every, untestable
