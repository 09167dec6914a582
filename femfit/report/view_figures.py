"""One solved point as pictures of the full section: mesh, flux lines, |B|, relative permeability.

Colours are drawn on the small triangles of :mod:`femfit.report.field_cells`, sharp at the parts' faces; flux lines are
contours of 2 pi r A_phi on the regular grid of :mod:`femfit.report.field_sample`.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.device.parts import Actuator, NonlinearMaterial, Region
from femfit.report.actuator_figure import draw_outlines
from femfit.report.field_cells import FieldCells
from femfit.report.field_figure import colour_range, draw_flux_lines, flux_levels
from femfit.report.field_sample import FieldSample
from femfit.report.kinds import COLOURS, IRON_FROM, kind_of
from femfit.report.numbers import plain, quantity, significant
from femfit.report.style import BLUE, INK, MUTED, PAPER, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM = 1e3
HEIGHT = 6.4
LIGHT = 0.35
"""Opacity of parts behind a mesh or flux lines."""


@styled
def mesh_figure(actuator: Actuator, sample: FieldSample, cells: FieldCells) -> "Figure":
    """Draw the finite elements over the parts.

    Parameters
    ----------
    sample : FieldSample
        For the window and the title.

    Returns
    -------
    Figure
        In mm.
    """
    figure, axes = _section(actuator, sample, "mesh")
    _light_parts(axes, actuator, sample)
    inside = _in_window(cells, cells.elements, sample)
    r, z = MM * cells.points_m.T
    for side in (1.0, -1.0):
        axes.triplot(side * r, z, cells.elements[inside], color=INK, linewidth=0.35)
    counts = f"{inside.sum():,} of {len(cells.elements):,} elements are in the picture; {sample.unknowns:,} unknowns"
    _note(axes, counts.replace(",", "\u2009"))
    return figure


@styled
def flux_lines_figure(actuator: Actuator, sample: FieldSample) -> "Figure":
    """Draw flux lines over the parts.

    Returns
    -------
    Figure
        In mm.
    """
    figure, axes = _section(actuator, sample, "flux lines")
    _light_parts(axes, actuator, sample)
    draw_flux_lines(axes, sample, color=BLUE, linewidth=0.8)
    levels = flux_levels(sample.flux_Wb)
    if len(levels) > 1:
        _note(axes, f"{quantity(float(np.diff(levels).min()), 'Wb')} between neighbouring lines")
    return figure


@styled
def flux_density_figure(actuator: Actuator, sample: FieldSample, cells: FieldCells) -> "Figure":
    """Draw |B| in colours, with flux lines.

    Parameters
    ----------
    sample : FieldSample
        For the window, the title and the flux lines.

    Returns
    -------
    Figure
        In mm; the colours are logarithmic.
    """
    from matplotlib.colors import LogNorm

    figure, axes = _section(actuator, sample, "flux density")
    low, high = colour_range(sample)
    magnitude = np.clip(np.hypot(*cells.flux_density_T.T), low, None)
    inside = _in_window(cells, cells.triangles, sample)
    shown = _colour(axes, cells, magnitude, inside, norm=LogNorm(low, high), cmap="turbo")
    draw_flux_lines(axes, sample, color="black", linewidth=0.45, alpha=0.75)
    draw_outlines(axes, actuator, sample.distance_m, edge=INK)
    _bar(figure, axes, shown, "|B| (T)", extend="both")
    largest = ", ".join(f"{_words(name)} {quantity(b, 'T')}" for name, b in sample.part_flux_density_T.items())
    _note(axes, f"Largest |B| off the corners: {largest}")
    return figure


@styled
def permeability_figure(actuator: Actuator, sample: FieldSample, cells: FieldCells) -> "Figure":
    """Draw mu_r = B / (mu_0 H) of the parts that are soft.

    Parameters
    ----------
    sample : FieldSample
        For the window and the title.

    Returns
    -------
    Figure
        In mm; the colours are logarithmic, and what is not soft is white.
    """
    from matplotlib.colors import LogNorm

    figure, axes = _section(actuator, sample, "relative permeability")
    parts = [(f"fixed:{region.name}", region) for region in actuator.fixed]
    parts += [(f"moving:{region.name}", region) for region in actuator.moving.regions]
    lines, soft = [], np.zeros(len(cells.regions), dtype=np.bool_)
    for name, region in parts:
        number = cells.regions.index(name)
        values = cells.relative_permeability[cells.point_region == number]
        soft[number] = region.material.relative_permeability >= IRON_FROM and not region.material.remanence_T
        lines.append(_permeability_line(region, values))
    _light_parts(axes, actuator, sample)
    shown_triangles = soft[cells.triangle_region]
    if shown_triangles.any():
        low, high = _range(cells.relative_permeability[soft[cells.point_region]])
        many = high > 1.01 * low
        norm = LogNorm(low, high) if many else LogNorm(0.5 * low, 2.0 * high)
        shown = _colour(axes, cells, cells.relative_permeability, shown_triangles, norm=norm, cmap="viridis")
        if many:
            _bar(figure, axes, shown, "B / (µ$_0$ H)", extend="both")
    draw_outlines(axes, actuator, sample.distance_m, edge=INK)
    _note(axes, "\n".join(lines))
    return figure


def _permeability_line(region: Region, values: FloatArray) -> str:
    low, high = _range(values)
    told = plain(low) if high < 1.001 * low else f"{significant(low)} to {significant(high)}"
    kind = "saturates" if isinstance(region.material, NonlinearMaterial) else "linear"
    if region.material.remanence_T:
        kind = "magnet, recoil"
    return f"{_words(region.name)}: {told} ({region.material.name}, {kind})"


def _range(values: FloatArray) -> tuple[float, float]:
    """Without the highest and lowest 1 %: fields are singular at corners."""
    low, high = np.percentile(values, (1.0, 99.0))
    return float(low), float(high)


def _words(name: str) -> str:
    return name.replace("_", " ")


def _section(actuator: Actuator, sample: FieldSample, what: str) -> tuple["Figure", "Axes"]:
    """An empty picture of the window, titled with the point and the force."""
    figure = new_figure(HEIGHT)
    axes = figure.subplots()
    titled(figure, actuator, sample, what)
    right, z = MM * sample.radius_m[-1], MM * sample.height_m
    # z grows downward, as in the drawing: the moving part hangs below
    axes.set(xlabel="r (mm)", ylabel="z (mm)", xlim=(-right, right), ylim=(z[-1], z[0]), aspect="equal")
    axes.grid(visible=False)
    axes.xaxis.set_major_formatter(lambda x, _: f"{abs(x):g}")
    return figure, axes


def titled(figure: "Figure", actuator: Actuator, sample: FieldSample, what: str) -> "Figure":
    """Write name, point and force over a picture."""
    figure.axes[0].set_title(f"{actuator.name}: {what}\n{point_title(sample)}", loc="left", fontweight="normal")
    return figure


def point_title(sample: FieldSample) -> str:
    """The point and its force in words."""
    force = sample.force_N
    sense = "" if not force else ", attracted" if force > 0.0 else ", repelled"
    return (
        f"d = {plain(MM * sample.distance_m, 4)} mm, i = {plain(sample.current_A, 4)} A, "
        f"F = {quantity(force, 'N', 4)}{sense}"
    )


def _light_parts(axes: "Axes", actuator: Actuator, sample: FieldSample) -> None:
    draw_outlines(axes, actuator, sample.distance_m, edge=INK, opacity=LIGHT)
    kinds = {kind_of(region.material, moving=False) for region in actuator.fixed} | {"winding"}
    kinds |= {kind_of(region.material, moving=True) for region in actuator.moving.regions}
    handles = [
        axes.fill([], [], facecolor=COLOURS[kind], alpha=LIGHT, edgecolor=INK, label=kind)[0]
        for kind in COLOURS
        if kind in kinds
    ]
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.01, 1.0), handlelength=1.2)


def _in_window(cells: FieldCells, triangles: Any, sample: FieldSample) -> BoolArray:
    """Triangles that reach into the picture."""
    r, z = cells.points_m[:, 0][triangles], cells.points_m[:, 1][triangles]
    low, high = sample.height_m[0], sample.height_m[-1]
    return np.asarray(
        (r.min(axis=1) < sample.radius_m[-1]) & (z.max(axis=1) > low) & (z.min(axis=1) < high), dtype=np.bool_
    )


def _colour(axes: "Axes", cells: FieldCells, values: FloatArray, shown: BoolArray, **colours: Any) -> Any:
    """Values at points in colours on both halves, rasterised."""
    from matplotlib.tri import Triangulation

    r, z = MM * cells.points_m.T
    for side in (1.0, -1.0):
        grid = Triangulation(side * r, z, cells.triangles[shown])
        drawn = axes.tripcolor(grid, values, shading="gouraud", rasterized=True, **colours)
    return drawn


def _bar(figure: "Figure", axes: "Axes", shown: Any, label: str, **more: Any) -> None:
    from matplotlib.ticker import LogLocator

    bar = figure.colorbar(shown, ax=axes, shrink=0.85, format="{x:g}", **more)
    low, high = shown.get_clim()
    subs = (1.0, 2.0, 5.0) if high > 4.0 * low else range(1, 10)
    bar.locator = LogLocator(subs=subs, numticks=30)
    bar.minorticks_off()
    bar.set_label(label)


def _note(axes: "Axes", words: str) -> None:
    axes.annotate(
        words,
        xy=(0.0, 0.0),
        xycoords="axes fraction",
        xytext=(0, -34),
        textcoords="offset points",
        va="top",
        fontsize=8,
        color=MUTED,
        backgroundcolor=PAPER,
        wrap=True,
    )
