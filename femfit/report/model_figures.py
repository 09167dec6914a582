"""How a model fits: laws ranked, maps of the misfit, the sensor's characteristic."""

from collections.abc import Sequence

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.fit.constants import TARGET
from femfit.fit.ranking import Ranking
from femfit.fit.rows import FitRows
from femfit.model.actuator_model import ActuatorModel
from femfit.report.style import BLUE, INK, MUTED, VERMILION, Figure, label, new_figure, ordered_colours, words

MM = 1e3
POINTS = 200


def ranking_figure(ranking: Ranking) -> Figure:
    """Draw each law's error, a bar a law with its floating-point operations, the recommended one dark."""
    fitted = [c for c in ranking.candidates if c.fit is not None]
    figure = new_figure(0.9 + 0.24 * len(fitted))
    axes = figure.subplots()
    names = [words("ranking", "law", law=c.law.name, operations=c.fit.operations) for c in fitted if c.fit is not None]
    errors = 100.0 * np.array([c.error for c in fitted])
    colours = [VERMILION if c is ranking.recommended else BLUE for c in fitted]
    # A logarithmic bar has no zero to start from: a decade below the least error
    low = 10.0 ** np.floor(np.log10(max(errors.min(), 1e-9)) - 0.3)
    axes.barh(names, errors - low, left=low, color=colours, height=0.65)
    axes.axvline(
        100.0 * TARGET, color=INK, linewidth=1.0, dashes=(4, 3), label=words("ranking", "target", target=100 * TARGET)
    )
    axes.set(xscale="log", xlim=(low, None), xlabel=words("ranking", "error", scale=ranking.of))
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.legend(loc="best")
    return figure


def residual_figure(rows: FitRows, forces: Sequence[tuple[str, FloatArray]]) -> Figure:
    """Draw each named force minus the solved one, in per cent of the weight or of the rms force, on its own scale."""
    from matplotlib.ticker import MaxNLocator

    figure = new_figure(2.9)
    panels = figure.subplots(1, len(forces), sharey=True, squeeze=False)[0]
    scale, of = rows.error_scale
    order = np.lexsort((rows.distance, rows.current))
    for ax, (name, force) in zip(panels, forces, strict=True):
        residual = 100.0 * ((force - rows.force) / scale)[order].reshape(len(rows.currents), len(rows.distances))
        largest = float(np.max(np.abs(residual))) or 1.0
        look = {"cmap": "RdBu_r", "vmin": -largest, "vmax": largest, "shading": "nearest", "rasterized": True}
        image = ax.pcolormesh(MM * rows.distances, rows.currents, residual, **look)
        ax.set(title=name, xlabel=words("residuals", "distance"))
        ax.grid(visible=False)
        bar = figure.colorbar(image, ax=ax, location="bottom", pad=0.03, aspect=22)
        bar.locator = MaxNLocator(4)
        bar.ax.tick_params(labelsize=8)
        bar.set_label(words("residuals", "error", scale=of), fontsize=8.5)
    panels[0].set_ylabel(words("residuals", "current"))
    return figure


def hall_figure(model: ActuatorModel, rows: FitRows) -> Figure:
    """Draw the sensor's output as the coil's part over voltage (or current), and as it is without current."""
    sensor = model.require_sensor()
    figure = new_figure(3.0)
    left, *rest = figure.subplots(1, 2 if model.has_magnet else 1, squeeze=False)[0]
    currents, distances = rows.currents, rows.distances
    fine = np.linspace(currents[0], currents[-1], POINTS)
    resistance = None if model.circuit is None else model.circuit.resistance_ohm
    across = fine if resistance is None else resistance * fine
    shown = distances[[0, len(distances) // 2, -1]]
    for colour, style, d in zip(ordered_colours(3), ("-", "--", ":"), shown, strict=True):
        field = sensor.field.field(np.full_like(fine, d), fine[:, None]) - sensor.field.field(np.array(d), np.zeros(1))
        text = words("hall", "level", distance=f"{MM * d:g}")
        left.plot(across, MM * sensor.sensitivity_V_per_T * field, style, color=colour, label=text)
    label(left, "hall", "current" if resistance is None else "voltage", "coil", "coil_title")
    left.legend(loc="upper left")
    if not rest:
        return figure
    right = rest[0]
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
