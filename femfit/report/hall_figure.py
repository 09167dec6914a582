"""The Hall characteristic: Figure 11 of the paper, coil part and magnet part."""

from typing import TYPE_CHECKING

import numpy as np

from femfit.fit.rows import FitRows
from femfit.model.actuator_model import ActuatorModel
from femfit.report.style import BLUE, MUTED, VERMILION, new_figure, ordered_colours, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MM = 1e3
POINTS = 200


@styled
def hall_figure(model: ActuatorModel, rows: FitRows) -> "Figure":
    """Draw the sensor's output as parts of coil and magnet.

    Parameters
    ----------
    model : ActuatorModel
        With sensor; with its circuit the coil part is drawn over the coil's voltage at rest, as in the paper.
    rows : FitRows
        The sweep, with the field at the Hall element.

    Returns
    -------
    Figure
        Coil part (left) at the shortest, middle and longest distance; magnet part (right) with the sweep's points.
    """
    sensor = model.require_sensor()
    figure = new_figure(3.0)
    left, right = figure.subplots(1, 2)
    currents, distances = rows.currents, rows.distances
    fine = np.linspace(currents[0], currents[-1], POINTS)
    resistance = None if model.circuit is None else model.circuit.resistance_ohm
    across = fine if resistance is None else resistance * fine
    shown = distances[[0, len(distances) // 2, -1]]
    for colour, style, d in zip(ordered_colours(3), ("-", "--", ":"), shown, strict=True):
        field = sensor.field.field(np.full_like(fine, d), fine) - sensor.field.field(np.array(d), np.array(0.0))
        left.plot(across, MM * sensor.sensitivity_V_per_T * field, style, color=colour, label=f"d = {MM * d:g} mm")
    left.set(
        xlabel="coil current (A)" if resistance is None else "coil voltage at rest, R i (V)",
        ylabel="coil part CH (mV)",
        title="coil part",
    )
    left.legend(loc="upper left")
    span = np.linspace(distances[0], distances[-1], POINTS)
    right.plot(MM * span, sensor.voltage(span, np.zeros_like(span)), color=BLUE, label="fitted, i = 0")
    if rows.hall is not None and np.any(rows.current == 0.0):
        at = rows.current == 0.0
        volts = sensor.quiescent_V + sensor.sensitivity_V_per_T * rows.hall[at]
        right.plot(MM * rows.distance[at], volts, "o", color=VERMILION, markersize=2.8, fillstyle="none", label="sweep")
    right.axhline(sensor.quiescent_V, color=MUTED, linewidth=1.0, dashes=(4, 3), label="quiescent output")
    right.set(xlabel="distance d (mm)", ylabel="Hall output at i = 0 (V)", title="magnet part MH")
    right.legend(loc="best")
    return figure
