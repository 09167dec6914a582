"""The model as figures: force over stroke and current, the sensor's characteristic, what several circuits do together.

Curves of a force need one current. The line taken through those of several circuits goes through the bias, along the
change in which the least currents give the most force: the differential drive of a bearing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from femfit.audit.audit_model import COLD_C, WARM_C
from femfit.core.errors import DomainError
from femfit.core.numerics import FloatArray
from femfit.core.results import remembered
from femfit.core.text import axis_scale
from femfit.device.mechanics import Mechanics
from femfit.device.parts import copper_growth
from femfit.estimate.holding import bias_currents, holding_currents
from femfit.fit.rows import FitRows
from femfit.heat.find_temperatures import Temperatures
from femfit.model.actuator_model import ActuatorModel
from femfit.report.style import (
    BLUE,
    CATEGORIES,
    INK,
    MUTED,
    ORANGE,
    VERMILION,
    Figure,
    label,
    new_figure,
    ordered_colours,
    plain,
    significant,
    words,
)

MM = 1e3
POINTS = 200

ROUNDED_AWAY = 1e-3
"""Conventional: part of the largest current below which a current of several circuits is called 0."""


@dataclass(frozen=True, eq=False)
class Supplied:
    """The force over the distances that the body can have, with the supply's voltage at a coil of some temperature."""

    temperature_C: float
    voltage_V: float
    current_A: float
    drawn_A: float  # The current within the model's validity domain that the force is taken at
    distance_m: FloatArray  # Shape (n,)
    force_N: FloatArray

    @property
    def limited(self) -> bool:
        """Whether the model ends below this current."""
        return abs(self.current_A - self.drawn_A) > 1e-6 * abs(self.current_A)


def at_supply(model: ActuatorModel, heat: Temperatures | None = None) -> tuple[Supplied, ...]:
    """The force with a cold and a warm coil, as warm as the supply makes it where that may last.

    Empty where the model has no circuit, or several.
    """
    circuit, box = model.circuit, model.validity
    if circuit is None:
        return ()
    warm_C = float(heat.windings_C[0]) if heat is not None and heat.lasts else WARM_C
    distance = np.linspace(*model.travel_m, POINTS)

    def supplied(voltage: float, celsius: float) -> Supplied:
        current = voltage / (circuit.resistance_ohm * float(copper_growth(celsius)))
        drawn = float(np.clip(current, box.current_min_A, box.current_max_A))
        force = np.asarray(model.force(distance, np.full_like(distance, drawn)))
        return Supplied(celsius, voltage, current, drawn, distance, force)

    ends = (circuit.voltage_max_V, circuit.voltage_min_V)
    # Where a supply is the same in both directions, the direction that attracts more
    warm = max((supplied(end, warm_C) for end in ends), key=lambda feed: (abs(feed.voltage_V), float(feed.force_N[0])))
    return supplied(warm.voltage_V, COLD_C), warm


def stroke_figure(feeds: Sequence[Supplied], motion: Mechanics | None) -> Figure:
    """Draw force over the stroke at the supply's voltage, and what it has to overcome."""
    figure = new_figure(3.6)
    axes = figure.subplots()
    factor, unit = axis_scale(np.concatenate([feed.force_N for feed in feeds]), "N")
    for feed, colour in zip(feeds, (BLUE, VERMILION), strict=True):
        facts = {"voltage": plain(feed.voltage_V, 3), "temperature": plain(feed.temperature_C, 3)}
        text = words("stroke", "feed", current=significant(feed.current_A), **facts)
        if feed.limited:
            text += words("stroke", "limited", drawn=significant(feed.drawn_A))
        axes.plot(MM * feed.distance_m, factor * feed.force_N, color=colour, label=text)
    distance = feeds[0].distance_m
    if motion is not None and np.any(against := motion.static_force(distance)):
        text = words("stroke", "static" if motion.springs or motion.load_N else "weight")
        axes.plot(MM * distance, factor * against, color=ORANGE, linewidth=1.0, dashes=(5, 3), label=text)
    label(axes, "stroke", "distance", "force", unit=unit)
    axes.legend(loc="best")
    return figure


@dataclass(frozen=True, eq=False)
class SweepGrid:
    """A full grid of m currents and n distances, force of shape (m, n)."""

    currents: FloatArray
    distances: FloatArray
    force: FloatArray


def sweep_grid(rows: FitRows) -> SweepGrid | None:
    """Arrange rows on their grid."""
    shape = (len(rows.currents), len(rows.distances))
    if len(rows.force) != shape[0] * shape[1]:
        return None
    order = np.lexsort((rows.distance, rows.current))
    return SweepGrid(rows.currents, rows.distances, rows.force[order].reshape(shape))


def force_curves_figure(grid: SweepGrid, weight: float | None, legend: str = "legend") -> Figure:
    """Draw force over distance, a curve for each current; ``legend`` names the words for what the current is."""
    figure = new_figure(3.6)
    axes = figure.subplots()
    factor, unit = axis_scale(grid.force, "N")
    currents = np.where(np.abs(grid.currents) < ROUNDED_AWAY * np.abs(grid.currents).max(), 0.0, grid.currents)
    for colour, current, force in zip(ordered_colours(len(currents)), currents, grid.force, strict=True):
        text = words("force-curves", "current", current=plain(current, 3))
        axes.plot(MM * grid.distances, factor * force, color=colour, label=text)
    if weight is not None:
        text = words("force-curves", "weight")
        axes.axhline(factor * weight, color=VERMILION, linewidth=1.0, dashes=(5, 3), label=text)
    label(axes, "force-curves", "distance", "force", unit=unit)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right center", title=words("force-curves", legend))
    return figure


def hall_figure(model: ActuatorModel, rows: FitRows) -> Figure:
    """Draw the sensor's output as the coil's part over voltage (or current), and as it is without current."""
    sensor = model.require_sensor()
    figure = new_figure(3.0)
    coil, *others = figure.subplots(1, 2 if model.has_magnet else 1, squeeze=False)[0]
    currents, distances = rows.currents, rows.distances
    fine = np.linspace(currents[0], currents[-1], POINTS)
    resistance = None if model.circuit is None else model.circuit.resistance_ohm
    across = fine if resistance is None else resistance * fine
    shown = distances[[0, len(distances) // 2, -1]]
    for colour, style, d in zip(ordered_colours(3), ("-", "--", ":"), shown, strict=True):
        field = sensor.field.field(np.full_like(fine, d), fine[:, None]) - sensor.field.field(np.array(d), np.zeros(1))
        text = words("hall", "level", distance=f"{MM * d:g}")
        coil.plot(across, MM * sensor.sensitivity_V_per_T * field, style, color=colour, label=text)
    label(coil, "hall", "current" if resistance is None else "voltage", "coil", "coil_title")
    coil.legend(loc="upper left")
    if not others:
        return figure
    right = others[0]
    span = np.linspace(distances[0], distances[-1], POINTS)
    right.plot(MM * span, sensor.voltage(span, np.zeros_like(span)), color=BLUE, label=words("hall", "fitted"))
    if rows.hall is not None and np.any(rows.current == 0.0):
        idle = rows.current == 0.0
        volts = sensor.quiescent_V + sensor.sensitivity_V_per_T * rows.hall[idle]
        look = {"color": VERMILION, "markersize": 2.8, "fillstyle": "none"}
        right.plot(MM * rows.distance[idle], volts, "o", label=words("hall", "sweep"), **look)
    right.axhline(sensor.quiescent_V, color=MUTED, linewidth=1.0, dashes=(4, 3), label=words("hall", "quiescent"))
    label(right, "hall", "distance", "magnet", "magnet_title")
    right.legend(loc="best")
    return figure


PLACES, CURRENTS = 61, 9
"""Of the line through the currents of several circuits: points along the distance, and curves."""


@dataclass(frozen=True, eq=False)
class SeveralCircuits:
    """A device of n circuits over the distances of its model."""

    names: tuple[str, ...]
    bias_A: FloatArray  # Shape (n,)
    along: FloatArray  # Change with the differential current, which attracts; the largest 1 in size; shape (n,)
    grid: SweepGrid  # The force over the differential current and the distance
    distance_m: FloatArray  # Shape (points,)
    holding_A: FloatArray  # NaN where no currents hold the body, the bias where its mass is unknown; (points, n)
    held: bool  # Whether the mass is known
    stiffness_N_per_m: FloatArray  # dF/dd less the slope of springs there; NaN where not held
    force_per_A: FloatArray  # dF/di_k there; shape (points, n)

    @property
    def line(self) -> list[tuple[str, str]]:
        """Each circuit's name and its current on the line, as text in the differential current x."""
        return [
            (name, f"{plain(bias, 3)} {'+' if factor >= 0.0 else '−'} {plain(abs(factor), 3)} x")
            for name, bias, factor in zip(self.names, self.bias_A, self.along, strict=True)
        ]


@remembered
def several_circuits(model: ActuatorModel) -> SeveralCircuits:
    """The facts of a model of several circuits."""
    limits = model.validity.current_limits_A
    box, magnetics = model.validity, model.magnetics
    middle = 0.5 * (box.distance_min_m + box.distance_max_m)
    bias = bias_currents(model, middle)
    strength = magnetics.motional_constant(np.asarray(middle), bias) * np.ptp(limits, axis=1) ** 2
    along = strength / np.abs(strength).max() if np.any(strength) else np.eye(len(bias))[0]
    distance = np.linspace(*model.travel_m, PLACES)
    held = model.motion is not None and bool(model.circuits)
    currents = np.array([_held(model, d, bias) if held else bias for d in distance])
    slopes = magnetics.slopes(distance, currents)
    springs = model.motion.static_gradient(distance) if model.motion is not None else 0.0
    return SeveralCircuits(
        names=model.current_names,
        bias_A=bias,
        along=along,
        grid=_along_the_line(model, bias, along, distance),
        distance_m=distance,
        holding_A=currents,
        held=held,
        stiffness_N_per_m=slopes.force_gradient - springs,
        force_per_A=slopes.motional_constant,
    )


def _held(model: ActuatorModel, distance: float, bias: FloatArray) -> FloatArray:
    try:
        return holding_currents(model, float(distance), bias)
    except DomainError:
        return np.full(len(bias), np.nan)


def _along_the_line(model: ActuatorModel, bias: FloatArray, along: FloatArray, distance: FloatArray) -> SweepGrid:
    """The model's force where all currents stay within the validity domain."""
    limits, moving = model.validity.current_limits_A, along != 0.0
    ends = np.sort((limits[moving] - bias[moving, None]) / along[moving, None], axis=1)
    changes = np.linspace(ends[:, 0].max(), ends[:, 1].min(), CURRENTS)
    currents = bias + changes[:, None, None] * along
    force = model.magnetics.force(distance, np.broadcast_to(currents, (CURRENTS, PLACES, len(bias))))
    return SweepGrid(changes, distance, force)


def circuits_figure(several: SeveralCircuits) -> Figure:
    """Draw currents and slopes of the force over the distance, a colour for each circuit."""
    figure = new_figure(2.9)
    currents, force, stiffness = figure.subplots(1, 3)
    x = MM * several.distance_m
    for k, name in enumerate(several.names):
        colour = CATEGORIES[k % len(CATEGORIES)]
        currents.plot(x, several.holding_A[:, k], color=colour, label=name)
        force.plot(x, several.force_per_A[:, k], color=colour)
    factor, unit = axis_scale(several.stiffness_N_per_m, "N")
    stiffness.plot(x, factor * several.stiffness_N_per_m, color=INK)
    label(currents, "circuits", "distance", "holding" if several.held else "bias")
    label(force, "circuits", "distance", "force")
    label(stiffness, "circuits", "distance", "stiffness", unit=unit)
    currents.legend(loc="best")
    return figure
