"""What each effect would do to these readings, to first order."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from femfit.core.numerics import FloatArray, IntArray
from femfit.effects.catalogue import OF_A_CIRCUIT
from femfit.effects.conditions import Nominal
from femfit.effects.effect import AddedEffect, Effect, EffectParameter
from femfit.effects.friction import REST
from femfit.identify.observations import Observations
from femfit.tables.header import parts_of
from femfit.tables.measurement import CHANNELS

ROUNDED = 1e-9
"""Numerical: part of a reading up to which a misfit, or an effect over its plausible range, is rounding."""

CHANGES_NOTHING = "it changes no reading at these settings"
"""Why an effect cannot be tested that would be seen at other settings."""

_CALLED = {REST: "a rest on a stop"}


def _without_part(nominal: Nominal) -> dict[str, str]:
    """Why a device cannot have what acts on a part that an effect may need; empty where it has the part."""
    unknown = (
        "whether there is a magnet is unknown: the model has no drawing and was fitted to no current of zero (fit it "
        "with --actuator)"
    )
    apart = "the co-energy of iron that several circuits saturate does not set the magnets' part apart"
    unseen = "without current the model has neither force nor flux linkage, so it has no magnet"
    faults = (  # the last one that holds is said
        ("magnet", not nominal.has_magnet, "the drawing has no magnet" if nominal.magnet_drawn else unseen),
        ("magnet", not nominal.magnet_known, unknown),
        ("magnet", not nominal.magnets_apart, apart),
        ("iron", not nominal.has_iron, "the drawing has no iron"),
        ("spring", nominal.springs is None, "the drawing has no spring"),
        ("voltage driver", not nominal.voltage_driver, "a current amplifier feeds the winding"),
        ("stop", not any(map(math.isfinite, nominal.stops_m)), "the drawing has no stop"),
    )
    return {component: "" for component, _, _ in faults} | {component: why for component, fault, why in faults if fault}


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
    parts, coil = _without_part(nominal), "" if nominal.peak_current_A > 0.0 else "the drawing has no coil"
    hall = "the model has no Hall element" if math.isnan(nominal.hall_quiescent_V) else ""
    absent = {**parts, **dict.fromkeys(OF_A_CIRCUIT, coil), "hall_V": hall}
    for need in effect.needs:
        reasons = [absent.get(name.lstrip("~"), "") for name in need.split("|")]
        if all(reasons):
            return reasons[0]
    # The balances of a record show what moves a body as a force sensor would, but nothing of a sensor that is not there
    read = effect.acts_on == ("sensor",)
    for need in effect.needs:
        if need not in parts and not any(_given(name, observations, read) for name in need.split("|")):
            names = [_CALLED.get(name, name) for name in need.replace("~", "").split("|")]
            return f"these data lack {'a varying ' if need.startswith('~') else ''}{' or '.join(names)}"
    return ""


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
    # The usual value stands first: it stays where readings say nothing
    ranges = {p.name: (p.null, *p.plausible) for p in effect.parameters if p.nonlinear}
    trials = [dict.fromkeys((null, low, low + 0.75 * (high - low))) for null, low, high in ranges.values()]
    variants = [
        AddedEffect(effect, effect.null() | dict(zip(ranges, values, strict=True))) for values in product(*trials)
    ]
    return [columns for variant in variants for columns in columns_at(variant, observations)]


def columns_at(added: AddedEffect, observations: Observations) -> list[EffectColumns]:
    """The columns of an effect at its own nonlinear parameters; empty where it changes none of these readings."""
    effect, nonlinear = added.effect, {p.name: added.parameters[p.name] for p in added.effect.parameters if p.nonlinear}
    absent = AddedEffect(effect, effect.null() | nonlinear)
    slopes = observations.predicted([absent], [(0, p.name) for p in effect.amplitudes])[:, 1:]
    moved = np.abs(slopes) * [p.width for p in effect.amplitudes] > ROUNDED * np.abs(observations.base)[:, None]
    visible = np.flatnonzero(moved.any(axis=0))
    if not len(visible):
        return []
    return [EffectColumns(effect, tuple(effect.amplitudes[k] for k in visible), nonlinear, slopes[:, visible])]


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
