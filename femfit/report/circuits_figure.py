"""Holding currents, stiffness, force per current and inductances of several circuits, as one figure."""

from typing import TYPE_CHECKING

from femfit.core.amount import axis_scale
from femfit.report.circuits import SeveralCircuits
from femfit.report.style import CATEGORIES, INK, MUTED, label, new_figure, styled, words

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@styled
def circuits_figure(several: SeveralCircuits) -> "Figure":
    """Draw currents, slopes of the force and inductances over the distance, a colour for each circuit."""
    figure = new_figure(5.4)
    (currents, force), (stiffness, inductance) = figure.subplots(2, 2)
    x = 1e3 * several.distance_m
    for k, name in enumerate(several.names):
        colour = CATEGORIES[k % len(CATEGORIES)]
        currents.plot(x, several.holding_A[:, k], color=colour, label=words("circuits", "circuit", name=name))
        force.plot(x, several.force_per_A[:, k], color=colour)
        inductance.plot(x, 1e3 * several.inductance_H[:, k, k], color=colour)
        for other in range(k):
            said = words("circuits", "mutual", one=several.names[other], other=name)
            inductance.plot(x, 1e3 * several.inductance_H[:, other, k], "--", color=MUTED, label=said)
    factor, unit = axis_scale(several.stiffness_N_per_m, "N")
    stiffness.plot(x, factor * several.stiffness_N_per_m, color=INK)
    label(currents, "circuits", "distance", "holding" if several.held else "bias")
    label(force, "circuits", "distance", "force")
    label(stiffness, "circuits", "distance", "stiffness", unit=unit)
    label(inductance, "circuits", "distance", "inductance")
    currents.legend(loc="best")
    inductance.legend(loc="best")
    return figure
