"""Pictures over time: an open loop, a closed one, a record that filters have seen, and a distance that is sensed."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.errors import TableError
from femfit.core.numerics import NORMAL_95
from femfit.core.sweep_columns import circuit_currents, voltage_columns
from femfit.estimate.observe import Observation, observe
from femfit.estimate.prepare import recorded_sensors, with_recorded_sensors
from femfit.model.actuator_model import ActuatorModel
from femfit.report.style import (
    BLUE,
    CATEGORIES,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    VERMILION,
    Figure,
    new_figure,
    words,
    write_picture,
)
from femfit.simulation.open_result import OpenLoop
from femfit.simulation.sense import Sensing
from femfit.simulation.summary import LoopSummary
from femfit.tables.measurement import TimeSeries

_MS = 1e3
_SPAN = 0.1
"""Conventional: share of its height that a panel leaves free at each end of its lines."""


def open_loop_figure(motion: OpenLoop) -> Figure:
    """Draw distance with the stops, velocity, current, voltage and forces over time, first touches marked."""
    figure = new_figure(7.0)
    panels = figure.subplots(5, 1, sharex=True, height_ratios=(1.6, 1.0, 1.0, 1.0, 1.2))
    table, mechanics = motion.table, motion.model.require_motion()
    time, names = _MS * table["time_s"], motion.model.circuit_names
    several = len(names) > 1
    for axes, columns, factor, colour, key in (
        (panels[0], ["distance_m"], 1e3, BLUE, "distance"),
        (panels[1], ["velocity_m_s"], 1.0, GREEN, "velocity"),
        (panels[2], circuit_currents(names), 1.0, VERMILION, "current"),
        (panels[3], voltage_columns(names), 1.0, MUTED, "voltage"),
    ):
        for k, column in enumerate(columns):
            of_circuit = several and axes in (panels[2], panels[3])
            look = CATEGORIES[k % len(CATEGORIES)] if of_circuit else colour
            axes.plot(time, factor * table[column], color=look, label=names[k] if of_circuit else None)
        axes.set_ylabel(words("open_loop", key))
    if several:
        panels[2].legend(ncols=len(names))
    for stop in (mechanics.near_stop, mechanics.far_stop):
        if stop is not None:
            panels[0].axhline(1e3 * stop.distance_m, color=INK, linewidth=0.7, dashes=(2, 2))
    panels[4].plot(time, table["force_N"], color=BLUE, label=words("open_loop", "magnetic"))
    panels[4].plot(time, table["static_force_N"], color=ORANGE, label=words("open_loop", "static"))
    panels[4].set(ylabel=words("open_loop", "force"), xlabel=words("open_loop", "time"))
    panels[4].legend(ncols=2)
    for axes in panels:
        for switching in motion.switchings:
            axes.axvline(_MS * switching.reached_s, color=MUTED, linewidth=0.7)
        for _, left_s in motion.left_domain:
            axes.axvspan(_MS * left_s, _MS * motion.end_s, color=MUTED, alpha=0.15)
        axes.margins(y=_SPAN)
    figure.align_ylabels()
    return figure


def closed_loop_figure(loop: LoopSummary) -> Figure:
    """Draw distances, currents and commands over time, of the first recorded run that was held, or the first of all."""
    figure = new_figure(5.0)
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(2.0, 1.0, 1.0))
    series, time = loop.result.series, loop.result.time_s
    run = int(np.argmax(loop.result.held[: series.distance_m.shape[1]]))
    top.plot(time, 1e3 * series.estimated_distance_m[:, run], color=BLUE, label=words("loop", loop.experiment.observer))
    top.plot(time, 1e3 * series.distance_m[:, run], color=INK, dashes=(4, 2), label=words("loop", "true"))
    top.plot(time, 1e3 * series.reference_m[:, run], color=GREEN, label=words("loop", "reference"))
    top.set_ylabel(words("loop", "distance"))
    names = loop.design.model.circuit_names
    for k, name in enumerate(names):
        look = CATEGORIES[k % len(CATEGORIES)]
        middle.plot(time, series.currents_A[:, run, k], color=look, label=name)
        bottom.plot(time, series.commands[:, run, k], color=look, linewidth=0.6, rasterized=True)
    if len(names) > 1:
        middle.legend(ncols=len(names))
    middle.set_ylabel(words("loop", "current"))
    bottom.set(ylabel=words("loop", "voltage", unit=loop.design.command_unit), xlabel=words("loop", "time"))
    figure.align_ylabels()
    figure.legend(*top.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


_COLOURS = (VERMILION, BLUE, GREEN, ORANGE)
_DASHES = ("-", "--", ":", "-.")
"""A line for each of several currents."""

_POINTS = 20_000
"""Conventional: points of a line; more are not seen."""


def replay_figure(observation: Observation, after: Observation | None = None) -> Figure:
    """Draw distance and currents as recorded and estimated, and the normalised innovations with their band.

    The filters are those of one observation, or the first of each of two, of a model before and after it was changed.
    """
    lines = [(words("loop", each.name), each.replayed) for each in observation.filters]
    if after is not None:
        pair = zip(("before", "after"), (observation, after), strict=True)
        lines = [(words("replay", key), record.filters[0].replayed) for key, record in pair]
    figure = new_figure(6.0)
    panels = figure.subplots(3, 1, sharex=True, height_ratios=(1.5, 1.0, 1.0))
    every = slice(None, None, max(1, len(observation.time_s) // _POINTS))
    runs = np.cumsum(np.r_[0.0, np.maximum(-np.diff(observation.time_s), 0.0)])
    time = (observation.time_s + runs)[every]  # runs one after the other
    currents = circuit_currents(observation.model.circuit_names)
    columns = [(panels[0], "distance_m", 0, 1e3, "-")]
    columns += [(panels[1], column, 2 + k, 1.0, _DASHES[k % len(_DASHES)]) for k, column in enumerate(currents)]
    for axes, column, state, factor, dashes in columns:
        if column in observation.recorded:
            look: dict[str, Any] = {"color": MUTED, "linewidth": 0.7, "label": words("replay", "recorded")}
            axes.plot(time, factor * observation.recorded[column][every], dashes, **look)
        for (text, replayed), colour in zip(lines, _COLOURS, strict=False):
            axes.plot(time, factor * replayed.mean[every, state], dashes, color=colour, label=text)
    panels[0].set(ylabel=words("replay", "distance_m"), ymargin=0.2)  # room for the legend
    panels[1].set_ylabel(words("replay", "current_A"))
    panels[0].legend(ncols=3, loc="upper right")
    for (_, replayed), colour in zip(lines, _COLOURS, strict=False):
        ratio = replayed.innovation[every] / np.sqrt(replayed.variance[every])
        panels[2].plot(time, ratio, ".", color=colour, markersize=1.0)
    for limit in (-NORMAL_95, NORMAL_95):
        panels[2].axhline(limit, color=INK, linewidth=0.7, dashes=(2, 2))
    panels[2].set(ylabel=words("replay", "innovation"), xlabel=words("replay", "time"), ylim=(-6.0, 6.0))
    figure.align_ylabels()
    return figure


def write_before_after(models: tuple[ActuatorModel, ActuatorModel], series: TimeSeries, path: Path) -> None:
    """Run the filters of two models over a record without reading its distance, and write the picture."""
    if "distance_m" not in series.given:
        raise TableError(
            f"The picture before and after needs a recorded distance to compare with; {series.source} holds "
            f"{', '.join(series.given)}. Leave out --picture, or record distance_m."
        )
    sensors = recorded_sensors(with_recorded_sensors(models[0], series), series, ("distance_m",))
    before, after = (observe(model, series, sensors=sensors, find=False) for model in models)
    write_picture(partial(replay_figure, before, after), path)


_FLOOR_M = 1e-7
"""Conventional: errors below a tenth of a micrometre are drawn as that."""


def sense_figure(sensing: Sensing) -> Figure:
    """Draw the motion with the filter's error, and that error beside its bound."""
    figure = new_figure(4.5)
    path, error = figure.subplots(2, 1)
    time, distance = 1e3 * sensing.time_s, 1e3 * sensing.distance_m
    rms = 1e3 * sensing.rms_m
    path.fill_between(time, distance - rms, distance + rms, color=BLUE, alpha=0.25, label=words("sense", "band"))
    path.plot(time, distance, color=INK, label=words("sense", "true"))
    path.set(ylabel=words("sense", "distance"), xticklabels=[])
    path.legend(ncols=2)
    for values, colour, key in (
        (sensing.rms_m, BLUE, "rms"),
        (sensing.claimed_m, VERMILION, "claimed"),
        (sensing.bound_m, MUTED, "bound"),
    ):
        error.semilogy(time, 1e6 * np.maximum(values, _FLOOR_M), color=colour, label=words("sense", key))
    error.set(ylabel=words("sense", "error"), xlabel=words("sense", "time"))
    error.legend(ncols=3)
    return figure
