"""The actuator drawn: full section, parts coloured by kind, dimensions, magnetisation, distance, Hall element."""

from typing import TYPE_CHECKING

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.device.parts import Actuator, Region
from femfit.report.kinds import COLOURS, HALL_COLOUR, kind_of
from femfit.report.mirror import full_section, moving_corners, standing_corners
from femfit.report.numbers import plain
from femfit.report.style import INK, MUTED, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM = 1e3

MIN_LABELLED = 0.15
"""Lengths below this part of the picture's height have their label beside the arrow."""


@styled
def actuator_figure(actuator: Actuator, distance: float) -> "Figure":
    """Draw an actuator.

    Parameters
    ----------
    distance : float
        At which the moving part is drawn, in m.

    Returns
    -------
    Figure
        In mm; the moving part is below, as z grows downward.
    """
    figure = new_figure(5.2, 6.6)
    axes = figure.subplots()
    draw_parts(axes, actuator, distance)
    _dimensions(axes, actuator, distance)
    _axis(axes, actuator, distance)
    axes.set(xlabel="x (mm)", ylabel="z (mm)", aspect="equal")
    left, right = axes.get_xlim()
    axes.set_xlim(left - 0.1 * (right - left), right)  # room for the label of a short distance
    axes.invert_yaxis()
    axes.grid(visible=False)
    axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), handlelength=1.2, labelspacing=0.8)
    return figure


def draw_parts(axes: "Axes", actuator: Actuator, distance: float) -> None:
    """The parts' full section, labelled, in mm."""
    labelled: set[str] = set()
    labels = [_region_label(region, moving=False) for region in actuator.fixed]
    labels += [_coil_label(actuator)]
    labels += [_region_label(region, moving=True) for region in actuator.moving.regions]
    for (outline, kind), label in zip(_outlines(actuator, distance), labels, strict=True):
        for piece in outline:
            words = "" if label in labelled else label
            axes.fill(*(MM * piece.T), facecolor=COLOURS[kind], edgecolor=INK, linewidth=0.8, label=words)
            labelled.add(label)
    for region in actuator.fixed:
        _magnetisation(axes, region, 0.0)
    for region in actuator.moving.regions:
        _magnetisation(axes, region, distance)
    if actuator.hall is not None:
        place = (MM * actuator.hall.radius_m, MM * actuator.hall.height_m)
        axes.plot(
            *place,
            "D",
            color=HALL_COLOUR,
            markeredgecolor=INK,
            markersize=6,
            zorder=5,
            label="Hall element ($B_z$)",
        )


def draw_outlines(axes: "Axes", actuator: Actuator, distance: float, *, edge: str, opacity: float = 0.0) -> None:
    """The parts' outlines in the full section, as over a field, in mm."""
    for outline, kind in _outlines(actuator, distance):
        for piece in outline:
            if opacity:
                axes.fill(*(MM * piece.T), facecolor=COLOURS[kind], edgecolor="none", alpha=opacity)
            axes.fill(*(MM * piece.T), facecolor="none", edgecolor=edge, linewidth=0.8)


def _outlines(actuator: Actuator, distance: float) -> list[tuple[tuple[FloatArray, ...], str]]:
    """Outlines and kind of each part: fixed ones, winding, moving ones."""
    parts = [(full_section(r.vertices_m), kind_of(r.material, moving=False)) for r in actuator.fixed]
    parts.append((full_section(actuator.coil.vertices_m), "winding"))
    parts += [(full_section(r.vertices_m, distance), kind_of(r.material, moving=True)) for r in actuator.moving.regions]
    return parts


def _region_label(region: Region, *, moving: bool) -> str:
    material = region.material
    data = f"µr {plain(material.relative_permeability)}"
    if material.remanence_T:
        data = f"Br {plain(abs(material.remanence_T))} T, {data}"
    return f"{kind_of(material, moving)}: {material.name}\n({data})"


def _coil_label(actuator: Actuator) -> str:
    wire = actuator.coil.wire_diameter_m
    size = "" if wire is None else f"\n(wire {plain(MM * wire)} mm)"
    return f"winding: {plain(actuator.coil.turns)} turns{size}"


def _magnetisation(axes: "Axes", region: Region, shift: float) -> None:
    if not region.material.remanence_T:
        return
    for outline in full_section(region.vertices_m, shift):
        low, high = outline.min(axis=0), outline.max(axis=0)
        x, length = 0.5 * (low[0] + high[0]), 0.7 * (high[1] - low[1])
        middle, sign = 0.5 * (low[1] + high[1]), np.sign(region.material.remanence_T)
        ends = (middle - 0.5 * sign * length, middle + 0.5 * sign * length)
        axes.annotate(
            "",
            xy=(MM * x, MM * ends[1]),
            xytext=(MM * x, MM * ends[0]),
            arrowprops={"arrowstyle": "-|>", "color": "white", "linewidth": 1.8, "mutation_scale": 13},
        )


def _axis(axes: "Axes", actuator: Actuator, distance: float) -> None:
    corners = np.concatenate([standing_corners(actuator), moving_corners(actuator, distance)])
    low, high = corners[:, 1].min(), corners[:, 1].max()
    over = 0.06 * (high - low)
    axes.plot([0.0, 0.0], [MM * (low - over), MM * (high + over)], color=MUTED, linewidth=0.7, dashes=(9, 3, 2, 3))


def _dimensions(axes: "Axes", actuator: Actuator, distance: float) -> None:
    still, moving = MM * standing_corners(actuator), MM * moving_corners(actuator, distance)
    (r_in, z_low), (r_out, z_high) = still.min(axis=0), still.max(axis=0)
    m_low, m_high, m_out = moving[:, 1].min(), moving[:, 1].max(), moving[:, 0].max()
    step = 0.17 * r_out
    _across(axes, r_out, z_low - 2.0 * step, z_low, f"Ø {plain(2 * r_out, 4)}")
    if r_in > 0:
        _across(axes, r_in, z_low - 0.8 * step, z_low, f"Ø {plain(2 * r_in, 4)}", outside=True)
    _along(axes, -r_out - step, z_low, z_high, -r_out, f"{plain(z_high - z_low, 4)}")
    bottom = max(m_high, z_high)
    _across(axes, m_out, bottom + step, m_high, f"Ø {plain(2 * m_out, 4)}")
    side = m_out + step if m_low >= z_high else r_out + step
    _along(axes, side, m_low, m_high, m_out, f"{plain(m_high - m_low, 4)}")
    place = -m_out - step if m_low >= z_high else -r_out - 2.6 * step
    _along(axes, place, 0.0, MM * distance, -min(m_out, r_out), f"d = {plain(MM * distance, 4)}", bold=True)


def _across(axes: "Axes", radius: float, z: float, z_part: float, label: str, *, outside: bool = False) -> None:
    """A diameter, with its extension lines to the part."""
    for x in (-radius, radius):
        axes.plot([x, x], [z_part, z], color=MUTED, linewidth=0.6)
    _arrow(axes, (-radius, z), (radius, z))
    if outside:
        axes.text(radius, z, f"  {label}", ha="left", va="center", fontsize=8)
    else:
        axes.text(0.0, z, label, ha="center", va="center", fontsize=8, bbox=_BOX)


def _along(
    axes: "Axes", x: float, z_from: float, z_to: float, x_part: float, label: str, *, bold: bool = False
) -> None:
    """A length along z, with its extension lines to the part."""
    for z in (z_from, z_to):
        axes.plot([x_part, x], [z, z], color=MUTED, linewidth=0.6)
    _arrow(axes, (x, z_from), (x, z_to))
    short = z_to - z_from < MIN_LABELLED * float(np.ptp(axes.dataLim.intervaly))
    axes.text(
        x,
        0.5 * (z_from + z_to),
        f"{label}  " if short else label,
        ha="right" if short else "center",
        va="center",
        rotation=0 if short else 90,
        fontsize=8.5 if bold else 8,
        fontweight="bold" if bold else "normal",
        bbox=_BOX,
    )


_BOX = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}


def _arrow(axes: "Axes", start: tuple[float, float], end: tuple[float, float]) -> None:
    style = {"arrowstyle": "<|-|>", "color": INK, "linewidth": 0.7, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 7}
    axes.annotate("", xy=end, xytext=start, arrowprops=style)
