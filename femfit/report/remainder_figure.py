"""What was learnt as unexplained: its size over distance and current, or over what it bends."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from femfit.core.amount import axis_scale
from femfit.effects.effect import AddedEffect
from femfit.identify.readings.observations import Observations
from femfit.model.bspline import TensorSpline
from femfit.model.carried import Carried, Curve, FieldTerm
from femfit.report.style import BLUE, INK, WIDTH, new_figure, styled, words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    Panel = Callable[[Figure, Axes], None]

_MM, _LEVELS, _POINTS = 1e3, 61, 400


@styled
def remainder_figure(added: AddedEffect, observations: Observations) -> "Figure":
    """One panel for each thing that the remainder changes, within the data."""
    panels = _panels(added, observations)
    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    figure = new_figure(0.2 + 2.7 * rows, width=min(WIDTH, 0.6 + 3.0 * columns))
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for draw, ax in zip(panels, axes, strict=False):
        draw(figure, ax)
    for ax in axes[len(panels) :]:
        ax.set_axis_off()
    return figure


def _panels(added: AddedEffect, observations: Observations) -> list["Panel"]:
    carried = added.effect.carried
    result: list[Panel] = []
    if not isinstance(carried, Carried):
        return result
    for term in carried.magnetics.terms if carried.magnetics else ():
        size = added.parameters[term.parameter] ** term.power
        if term.coenergy is not None:
            result += [
                _map("force", "N", term, term.coenergy, (1, 0), -size, observations),
                _map("flux", "Wb", term, term.coenergy, (0, 1), size, observations),
            ]
        if term.hall is not None:
            result.append(_map("hall", "T", term, term.hall, (0, 0), size, observations))
    curves: dict[str, Curve | None] = dict((carried.readings.channels if carried.readings else {}).items())
    curves |= {"force_branch": carried.readings.branches.get("force_N")} if carried.readings else {}
    if carried.setting:
        curves |= {"distance_m": carried.setting.distance_m, "current_A": carried.setting.current_A}
    curves |= {"brake": carried.brake.against} if carried.brake else {}
    curves |= {"resistance": carried.resistance.over} if carried.resistance else {}
    return result + [_line(name, one, added) for name, one in curves.items() if one is not None]


def _map(
    what: str,
    unit: str,
    term: FieldTerm,
    spline: TensorSpline,
    order: tuple[int, int],
    size: float,
    observations: Observations,
) -> "Panel":
    """A change of the field over distance and current, with the settings that were measured."""

    def draw(figure: "Figure", ax: "Axes") -> None:
        d, i = (observations.covariates[name].to_numpy() for name in ("distance_m", "current_A"))
        across, up = (np.linspace(x.min(), x.max(), _LEVELS) for x in (d, i))
        at_d, at_i = np.meshgrid(across, up)
        flat = term.coordinate.partial_derivatives(spline, at_d.ravel(), at_i.ravel(), (order,))[0]
        values = size * flat.reshape(at_d.shape)
        factor, shown = axis_scale(values, unit)
        limit = max(float(np.abs(factor * values).max()), 1e-300)
        image = ax.pcolormesh(
            _MM * across,
            up,
            factor * values,
            cmap="RdBu_r",
            vmin=-limit,
            vmax=limit,
            shading="gouraud",
            rasterized=True,
        )
        ax.plot(_MM * d, i, ".", color=INK, markersize=1.5)
        ax.grid(visible=False)
        ax.set(xlabel=words("remainder", "distance"), ylabel=words("remainder", "current"))
        ax.set_title(words("remainder", what, unit=shown))
        figure.colorbar(image, ax=ax)

    return draw


def _line(name: str, curve: Curve, added: AddedEffect) -> "Panel":
    """A curve between the ends of its data: the outer cells of its knots, where it is constant, are left out."""

    def draw(figure: "Figure", ax: "Axes") -> None:  # noqa: ARG001  a panel's signature
        breaks = np.unique(curve.knots)
        x = np.linspace(breaks[curve.degree], breaks[-1 - curve.degree], _POINTS)
        y = curve.at(x, added.parameters)
        own, over = (words("remainder", f"{name}_{side}").partition("|") for side in ("y", "x"))
        scales = [axis_scale(values, unit[2]) for values, unit in ((y, own), (x, over))]
        ax.plot(scales[1][0] * x, scales[0][0] * y, color=BLUE)
        ax.axhline(0.0, color=INK, linewidth=0.6)
        ax.set(xlabel=f"{over[0]} ({scales[1][1]})", ylabel=f"{own[0]} ({scales[0][1]})")

    return draw
