"""A solved point as pictures of the full section: mesh, flux lines, |B|, relative permeability.

Colours are drawn on the small triangles of :mod:`femfit.report.field_cells`, sharp at the parts' faces, or, where a
page needs it quickly, on the regular grid of :mod:`femfit.report.field_cells`; flux lines are contours of 2 pi r A_phi
on that grid. |B| is coloured by its square root, so that both the air and iron between 0.5 and 2 T keep their shades.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.numerics import BoolArray, FloatArray
from femfit.device.drawn_numbers import NumberFacts
from femfit.device.parts import Actuator, NonlinearMaterial, Region, is_iron
from femfit.report.drawing import actuator_figure, draw_outlines
from femfit.report.field_cells import FieldCells, FieldSample, SolvedPoint, field_cells, sample_of, write_vtu
from femfit.report.parts import COLOURS, half_sections, mirrored
from femfit.report.style import (
    BLUE,
    INK,
    MUTED,
    PAPER,
    Axes,
    Figure,
    new_figure,
    plain,
    quantity,
    significant,
    words,
    write_picture,
)

PICTURES = ("geometry", "mesh", "flux-lines", "flux-density", "permeability")
VTU = "vtu"
DPI = 170

MM = 1e3
LINES = 18
"""Flux lines, each pair with the same flux between them."""

LIGHT = 0.35
"""Opacity of parts behind a mesh or flux lines."""

_NO_FIELD_T = 1e-6
"""Largest flux density of what counts as an actuator without a magnet and without current."""


def write_views(
    point: SolvedPoint, files: Sequence[tuple[str, Path]], numbers: Sequence[NumberFacts] = ()
) -> FieldSample:
    """Draw a point into files: what, of :data:`PICTURES` or ``vtu``, and where; the suffix names a picture's format.

    The geometry is drawn with these numbers of its drawing.
    """
    actuator, sample, cells = point.actuator, sample_of(point), field_cells(point)
    draw: dict[str, Callable[[], Figure]] = {
        "geometry": lambda: actuator_figure(actuator, point.distance_m, _title(actuator, sample, "geometry"), numbers),
        "mesh": lambda: mesh_figure(actuator, sample, cells),
        "flux-lines": lambda: flux_lines_figure(actuator, sample),
        "flux-density": lambda: flux_density_figure(actuator, sample, cells),
        "permeability": lambda: permeability_figure(actuator, sample, cells),
    }
    for what, path in files:
        if what == VTU:
            write_vtu(point, cells, path)
            continue
        write_picture(draw[what], path, DPI, bbox_inches="tight")
    return sample


def colour_limit(sample: FieldSample) -> float:
    """Largest |B| of the colours in T, a whole step of 1, 2 or 5; a microtesla where there is no field at all."""
    top = max(float(np.percentile(sample.flux_density_T, 99.7)), _NO_FIELD_T)
    decade = 10.0 ** np.floor(np.log10(top))
    return float(next(s * decade for s in (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0) if s * decade >= top))


def colours_of(limit: float, name: str) -> dict[str, Any]:
    """Colour map and norm of |B|."""
    from matplotlib.colors import PowerNorm

    return {"norm": PowerNorm(0.5, 0.0, limit), "cmap": name}


def flux_levels(flux: FloatArray) -> FloatArray:
    """Fluxes in Wb of the lines drawn, equally spaced, without zero, which is the axis; none where there is no flux."""
    low, high = min(float(flux.min()), 0.0), max(float(flux.max()), 0.0)
    if low == high:
        return np.zeros(0)
    step = (high - low) / (LINES + 1)
    levels = step * np.arange(np.ceil(low / step), np.floor(high / step) + 1)
    inside = (levels > low + 0.5 * step) & (levels < high - 0.5 * step) & (np.abs(levels) > 0.5 * step)
    return np.asarray(levels[inside])


def line_flux(sample: FieldSample) -> float | None:
    """Flux in Wb between neighbouring lines; None for fewer than two."""
    levels = flux_levels(sample.flux_Wb)
    return float(np.diff(levels).min()) if len(levels) > 1 else None


def draw_flux_lines(axes: Axes, sample: FieldSample, **line_style: Any) -> None:
    """Draw flux lines on the full section, in mm."""
    from contourpy import contour_generator

    x, flux = mirrored(sample.radius_m, sample.flux_Wb)
    contours = contour_generator(MM * x, MM * sample.height_m, flux)
    for level in flux_levels(sample.flux_Wb):
        for line in contours.lines(level):
            # As lines, not as one collection: matplotlib thins the points of lines only
            axes.plot(*np.asarray(line).T, **line_style)


def field_figure(actuator: Actuator, sample: FieldSample) -> Figure:
    """Draw |B| in colours on the regular grid, flux lines and outlines, for a page."""
    figure, axes = _section(sample)
    x, density = mirrored(sample.radius_m, sample.flux_density_T)
    z = sample.height_m
    image = axes.imshow(
        density,
        extent=(MM * x[0], MM * x[-1], MM * z[0], MM * z[-1]),
        origin="lower",
        interpolation="bilinear",
        **colours_of(colour_limit(sample), "cividis"),
    )
    draw_flux_lines(axes, sample, color="white", linewidth=0.55, alpha=0.8)
    draw_outlines(axes, actuator, sample.distance_m, edge="white")
    axes.set(xlim=(MM * x[0], MM * x[-1]), ylim=(MM * z[-1], MM * z[0]))
    _bar(axes, image, words("field", "flux_density"), extend="max")
    return figure


def mesh_figure(actuator: Actuator, sample: FieldSample, cells: FieldCells) -> Figure:
    """Draw the finite elements over the parts, in mm."""
    figure, axes = _section(sample, _title(actuator, sample, "mesh"))
    _light_parts(axes, actuator, sample)
    inside = _in_window(cells, cells.elements, sample)
    r, z = MM * cells.points_m.T
    for side in (1.0, -1.0):
        axes.triplot(side * r, z, cells.elements[inside], color=INK, linewidth=0.35)
    counts = [f"{count:,}".replace(",", "\u2009") for count in (inside.sum(), len(cells.elements), sample.unknowns)]
    _note(axes, words("mesh", "note", shown=counts[0], elements=counts[1], unknowns=counts[2]))
    return figure


def flux_lines_figure(actuator: Actuator, sample: FieldSample) -> Figure:
    """Draw flux lines over the parts, in mm."""
    figure, axes = _section(sample, _title(actuator, sample, "flux-lines"))
    _light_parts(axes, actuator, sample)
    draw_flux_lines(axes, sample, color=BLUE, linewidth=0.8)
    if flux := line_flux(sample):
        _note(axes, words("flux-lines", "note", flux=quantity(flux, "Wb")))
    return figure


def flux_density_figure(actuator: Actuator, sample: FieldSample, cells: FieldCells) -> Figure:
    """Draw |B| in colours, sharp at the parts' faces, with flux lines, in mm."""
    figure, axes = _section(sample, _title(actuator, sample, "flux-density"))
    magnitude = np.hypot(*cells.flux_density_T.T)
    inside = _in_window(cells, cells.triangles, sample)
    shown = _colour(axes, cells, magnitude, inside, **colours_of(colour_limit(sample), "turbo"))
    draw_flux_lines(axes, sample, color="black", linewidth=0.45, alpha=0.75)
    draw_outlines(axes, actuator, sample.distance_m, edge=INK)
    _bar(axes, shown, words("field", "flux_density"), extend="max")
    largest = [f"{name.replace('_', ' ')} {quantity(b, 'T')}" for name, b in sample.part_flux_density_T.items()]
    _note(axes, words("flux-density", "note", largest=", ".join(largest)))
    return figure


def permeability_figure(actuator: Actuator, sample: FieldSample, cells: FieldCells) -> Figure:
    """Draw mu_r = B / (mu_0 H) of the soft parts on a logarithmic scale; what is not soft is white."""
    from matplotlib.colors import LogNorm

    figure, axes = _section(sample, _title(actuator, sample, "permeability"))
    fixed = len(actuator.fixed)
    lines, soft = [], np.zeros(len(cells.regions), dtype=np.bool_)
    for k, region in enumerate(actuator.regions):
        number = cells.regions.index(f"{'fixed' if k < fixed else 'moving'}:{region.name}")
        soft[number] = is_iron(region.material)
        lines.append(_permeability_line(region, cells.relative_permeability[cells.point_region == number]))
    _light_parts(axes, actuator, sample, 1.22)
    shown_triangles = soft[cells.triangle_region]
    if shown_triangles.any():
        low, high = _range(cells.relative_permeability[soft[cells.point_region]])
        many = high > 1.01 * low
        norm = LogNorm(low, high) if many else LogNorm(0.5 * low, 2.0 * high)
        shown = _colour(axes, cells, cells.relative_permeability, shown_triangles, norm=norm, cmap="viridis")
        if many:
            _bar(axes, shown, words("permeability", "bar"), extend="both", logarithmic=True)
    draw_outlines(axes, actuator, sample.distance_m, edge=INK)
    _note(axes, "\n".join(lines))
    return figure


def _permeability_line(region: Region, values: FloatArray) -> str:
    low, high = _range(values)
    ends = dict.fromkeys((significant(low), significant(high)) if high > 1.001 * low else (plain(low),))
    interval = " to ".join(ends)
    kind = "saturates" if isinstance(region.material, NonlinearMaterial) else "linear"
    kind = "recoil" if region.material.remanence_T else kind
    name = region.name.replace("_", " ")
    return words("permeability", kind, part=name, values=interval, material=region.material.name)


def _range(values: FloatArray) -> tuple[float, float]:
    """Without the highest and lowest 1 %: fields are singular at corners."""
    low, high = np.percentile(values, (1.0, 99.0))
    return float(low), float(high)


def _section(sample: FieldSample, title: str = "") -> tuple[Figure, Axes]:
    """An empty picture of the window with as much height as it needs; z points down, as in the drawing."""
    right, z = MM * sample.radius_m[-1], MM * sample.height_m
    figure = new_figure(float(np.clip(0.9 + 5.0 * np.ptp(z) / (2.0 * right), 3.2, 6.6)), 6.8)
    axes = figure.subplots()
    axes.set(xlabel=words("field", "r"), ylabel=words("field", "z"), xlim=(-right, right), ylim=(z[-1], z[0]))
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.xaxis.set_major_formatter(lambda x, _: f"{abs(x):g}")
    axes.set_title(title, loc="left", fontweight="normal")
    return figure, axes


def _title(actuator: Actuator, sample: FieldSample, what: str) -> str:
    return f"{actuator.name}: {words(what, 'title')}\n{point_title(sample)}"


def point_title(sample: FieldSample) -> str:
    """The point and its force in words."""
    force = sample.force_N
    sense = words("point", "attracted" if force > 0.0 else "repelled") if force else ""
    distance = plain(MM * sample.distance_m, 4)
    current = " and ".join(plain(current, 4) for current in np.atleast_1d(sample.current_A))
    return words("point", "title", distance=distance, current=current, force=quantity(force, "N", 4), sense=sense)


def _light_parts(axes: Axes, actuator: Actuator, sample: FieldSample, legend: float = 1.01) -> None:
    draw_outlines(axes, actuator, sample.distance_m, edge=INK, opacity=LIGHT)
    kinds = {kind for _, _, kind in half_sections(actuator, sample.distance_m)}
    handles = [
        axes.fill([], [], facecolor=COLOURS[kind], alpha=LIGHT, edgecolor=INK, label=words("kinds", kind))[0]
        for kind in COLOURS
        if kind in kinds
    ]
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(legend, 1.0), handlelength=1.2)


def _in_window(cells: FieldCells, triangles: Any, sample: FieldSample) -> BoolArray:
    """Triangles that reach into the picture."""
    r, z = cells.points_m[:, 0][triangles], cells.points_m[:, 1][triangles]
    low, high = sample.height_m[0], sample.height_m[-1]
    return np.asarray(
        (r.min(axis=1) < sample.radius_m[-1]) & (z.max(axis=1) > low) & (z.min(axis=1) < high), dtype=np.bool_
    )


def _colour(axes: Axes, cells: FieldCells, values: FloatArray, shown: BoolArray, **colours: Any) -> Any:
    """Values at points in colours on both halves, rasterised."""
    from matplotlib.tri import Triangulation

    r, z = MM * cells.points_m.T
    for side in (1.0, -1.0):
        grid = Triangulation(side * r, z, cells.triangles[shown])
        drawn = axes.tripcolor(grid, values, shading="gouraud", rasterized=True, **colours)
    return drawn


def _bar(axes: Axes, shown: Any, label: str, *, extend: str, logarithmic: bool = False) -> None:
    """A colour bar as high as the picture beside it."""
    from matplotlib.ticker import LogLocator

    place = axes.inset_axes((1.04, 0.0, 0.04, 1.0))
    figure = axes.get_figure()
    assert figure is not None  # noqa: S101 - made in _section
    bar = figure.colorbar(shown, cax=place, format="{x:g}", extend=extend)
    if logarithmic:
        low, high = shown.get_clim()
        bar.locator = LogLocator(subs=(1.0, 2.0, 5.0) if high > 4.0 * low else range(1, 10), numticks=30)
        bar.minorticks_off()
    else:
        limit = shown.get_clim()[1]
        bar.set_ticks([limit * share for share in (0.0, 0.01, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)])
    bar.set_label(label)


def _note(axes: Axes, note: str) -> None:
    """Words below a picture, broken so that they stay below it."""
    from textwrap import fill

    axes.annotate(
        "\n".join(fill(line, 78) for line in note.split("\n")),
        xy=(0.0, 0.0),
        xycoords="axes fraction",
        xytext=(0, -34),
        textcoords="offset points",
        va="top",
        fontsize=8,
        color=MUTED,
        backgroundcolor=PAPER,
    )
