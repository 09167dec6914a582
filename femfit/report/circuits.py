"""What several circuits do together: currents that hold, stiffness, force per current, and one line through them.

Curves of a force need one current. The line taken goes through the bias, along the change in which the least
currents give the most force: the differential drive of a bearing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.numerics import FloatArray
from femfit.core.text import axis_scale
from femfit.estimate.holding import bias_currents, holding_currents
from femfit.model.actuator_model import ActuatorModel
from femfit.report.model_figures import SweepGrid
from femfit.report.style import CATEGORIES, INK, Figure, label, new_figure, plain

POINTS, CURRENTS = 61, 9


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


def several_circuits(model: ActuatorModel) -> SeveralCircuits | None:
    """The facts of a model of several circuits; None of any other."""
    limits = model.validity.current_limits_A
    if len(limits) < 2:
        return None
    box, magnetics = model.validity, model.magnetics
    middle = 0.5 * (box.distance_min_m + box.distance_max_m)
    bias = bias_currents(model, middle)
    strength = magnetics.motional_constant(np.asarray(middle), bias) * np.ptp(limits, axis=1) ** 2
    along = strength / np.abs(strength).max() if np.any(strength) else np.eye(len(bias))[0]
    distance = np.linspace(*model.travel_m, POINTS)
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
    force = model.magnetics.force(distance, np.broadcast_to(currents, (CURRENTS, POINTS, len(bias))))
    return SweepGrid(changes, distance, force)


def at_currents(current: float | Sequence[float], names: Sequence[str], digits: int = 4) -> str:
    """Currents as a text: ``2 A``, or ``lower 2 A and upper −1 A``."""
    if isinstance(current, int | float):
        return f"{plain(current, digits)} A"
    each = (f"{name} {plain(value, digits)} A" for name, value in zip(names, current, strict=True))
    return " and ".join(each)


def current_ranges(model: ActuatorModel) -> list[str]:
    """The validity domain's currents, by name where there are several; none of magnets alone."""
    if not model.has_winding:
        return []
    limits = model.validity.current_limits_A
    names = [f"{name} " for name in model.current_names] if len(limits) > 1 else [""]
    return [f"{name}{plain(low)} to {plain(high)} A" for name, (low, high) in zip(names, limits, strict=True)]


def circuits_figure(several: SeveralCircuits) -> Figure:
    """Draw currents and slopes of the force over the distance, a colour for each circuit."""
    figure = new_figure(2.9)
    currents, force, stiffness = figure.subplots(1, 3)
    x = 1e3 * several.distance_m
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
