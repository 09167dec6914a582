"""Errors that do not act all the time: they begin, end or change at a run, or grow without a reset."""

from dataclasses import replace
from typing import Literal

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.trial.device import Conditions, Device, HiddenError, Readings
from femfit.trial.field_table import Fields
from femfit.trial.truths.truth import Truth, no_hall

Shape = Literal["begins", "ends", "interval"]


def only_in_some_runs(truth: Truth, name: str, shape: Shape) -> Truth:
    """A truth that begins at a run, ends before one, or acts from one to another."""

    def build(device: Device, rng: np.random.Generator) -> HiddenError:
        error, share, length = truth.build(device, rng), float(rng.uniform()), float(rng.uniform())
        named = error if error.names is not None else replace(error, names=(name,))
        return replace(named, course=lambda runs: _acting(shape, runs, share, length))

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


def acting_only(error: HiddenError, runs: tuple[int, int]) -> HiddenError:
    """An error that is away outside of the runs from a first to a last one, from 1."""

    def acts(at: Conditions) -> BoolArray:
        return np.asarray((at.run + 1 >= runs[0]) & (at.run + 1 <= runs[1]))

    def setting(device: Device, size: float, at: Conditions) -> Conditions:
        changed, now = (error.setting or _same)(device, size, at), acts(at)
        return replace(
            at,
            distance=np.where(now, changed.distance, at.distance),
            current=np.where(now, changed.current, at.current),
        )

    def fields(device: Device, size: float, at: Conditions) -> Fields:
        if error.fields is None:
            return device.drawn.at(at.distance, at.current).times(0.0)
        return error.fields(device, size, at).times(acts(at).astype(np.float64))

    def reading(device: Device, size: float, at: Conditions, values: Readings) -> Readings:
        changed = error.reading(device, size, at, values) if error.reading else {}
        return {name: np.where(acts(at), value, values[name]) for name, value in changed.items()}

    return replace(
        error,
        setting=setting if error.setting else None,
        fields=fields if error.fields else None,
        reading=reading if error.reading else None,
    )


def _same(device: Device, size: float, at: Conditions) -> Conditions:
    del device, size
    return at


def integrator(law: Literal["square", "no reset", "leaky"]) -> Truth:
    """A fluxmeter that drifts: faster and faster in each run, over the campaign without a reset, or until it leaks."""

    def course(at: Conditions) -> FloatArray:
        if law == "no reset":
            return at.campaign_s
        whole = max(float(at.time_s.max()), 1.0)
        if law == "square":
            return at.time_s * (1.0 + at.time_s / whole)
        return np.asarray(0.3 * whole * (1.0 - np.exp(-at.time_s / (0.3 * whole))))

    error = HiddenError(
        lambda _: 1e-4,
        ("flux_linkage_Wb",),
        reading=lambda device, size, at, values: {"flux_linkage_Wb": values["flux_linkage_Wb"] + size * course(at)},
        names=("flux_integrator_drift",),
    )
    return Truth(lambda _, rng: error)


def drift(channel: Literal["force_N", "hall_V"], law: Literal["line", "settling", "walk"]) -> Truth:
    """A zero that drifts over the campaign: on a line, until it has settled, or as a random walk beside that."""

    def build(device: Device, rng: np.random.Generator) -> HiddenError:
        share, seed = float(rng.uniform(0.15, 0.6)), int(rng.integers(2**31))

        def course(at: Conditions) -> FloatArray:
            x = at.campaign_s / max(float(at.campaign_s.max()), 1.0)
            settled = (1.0 - np.exp(-x / share)) / (1.0 - np.exp(-1.0 / share))
            count = len(x)
            walk = np.cumsum(np.random.default_rng(seed).standard_normal(count)) / np.sqrt(count)
            return np.asarray({"line": x, "settling": settled, "walk": settled + 0.3 * walk}[law])

        return HiddenError(
            lambda device: 0.3 * (device.largest_force if channel == "force_N" else 1.0),
            (channel,),
            reading=lambda _, size, at, values: {channel: values[channel] + size * course(at)},
            names=("hall_drift",) if channel == "hall_V" else ("force_drift", "force_offset", "constant_force"),
            constants={"share": share},
        )

    if channel == "hall_V":
        return Truth(build, "catalogue", no_hall)
    return Truth(build, "when")
