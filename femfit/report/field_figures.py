"""A solved point as pictures of the full section: mesh, flux lines, |B|.

Colours are those of the regular grid of :mod:`femfit.report.field_sample`, on which flux lines are contours of
2 pi r A_phi. |B| is coloured by its square root, so that both the air and iron between 0.5 and 2 T keep their shades.
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.device.parts import Actuator
from femfit.report.drawing import COLOURS, actuator_figure, draw_outlines, drawn_parts, mirrored
from femfit.report.field_sample import FieldSample, SolvedPoint, write_vtu
from femfit.report.style import BLUE, INK, MUTED, PAPER, Axes, Figure, new_figure, plain, quantity, words, write_picture

PICTURES = ("geometry", "mesh", "flux-lines", "flux-density")
VTU = "vtu"
DPI = 170

MM = 1e3
LINES = 18
"""Flux lines, each pair with the same flux between them."""

LIGHT = 0.35
"""Opacity of parts behind a mesh or flux lines."""

_NO_FIELD_T = 1e-6
"""Largest flux density of what counts as an actuator without a magnet and without current."""


def write_view(what: str, point: SolvedPoint, path: Path) -> None:
    """Draw a point into a file: one of :data:`PICTURES` in the format of the suffix, or ``vtu``."""
    if what == VTU:
        write_vtu(point, path)
    else:
        write_picture(partial(view_figure, what, point), path, DPI, bbox_inches="tight")


def view_figure(what: str, point: SolvedPoint) -> Figure:
    """Draw one of :data:`PICTURES` of a point."""
    actuator, sample = point.actuator, point.sample
    title = f"{actuator.name}: {words(what, 'title')}\n{point_title(sample)}"
    draw = {
        "geometry": lambda: actuator_figure(actuator, point.distance_m, title),
        "mesh": lambda: mesh_figure(point, title),
        "flux-lines": lambda: flux_lines_figure(actuator, sample, title),
        "flux-density": lambda: field_figure(actuator, sample, title),
    }
    return draw[what]()


def middle_point(actuator: Actuator) -> tuple[float, float | tuple[float, ...]]:
    """The middle distance of the sweep in m, and its largest currents in A."""
    axes = actuator.sweep
    largest = tuple(max(axis) for axis in (axes.currents_A, *axes.further_A))
    return axes.distances_m[len(axes.distances_m) // 2], largest if axes.further_A else largest[0]


def colour_limit(sample: FieldSample) -> float:
    """Largest |B| of the colours in T, a whole step of 1, 2 or 5; a microtesla where there is no field at all."""
    top = max(float(np.percentile(sample.flux_density_T, 99.7)), _NO_FIELD_T)
    decade = 10.0 ** np.floor(np.log10(top))
    return float(next(s * decade for s in (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0) if s * decade >= top))


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


def field_figure(actuator: Actuator, sample: FieldSample, title: str = "") -> Figure:
    """Draw |B| in colours, flux lines and outlines, in mm."""
    from matplotlib.colors import PowerNorm

    figure, axes = _section(sample, title)
    limit, norm = colour_limit(sample), PowerNorm(0.5, 0.0, colour_limit(sample))
    x, magnitude = mirrored(sample.radius_m, sample.flux_density_T)
    extent = MM * np.array([x[0], x[-1], sample.height_m[0], sample.height_m[-1]])
    look: dict[str, Any] = {"origin": "lower", "interpolation": "bilinear", "cmap": "cividis", "norm": norm}
    image = axes.imshow(magnitude, extent=tuple(extent), **look)
    axes.set_ylim(extent[3], extent[2])
    draw_flux_lines(axes, sample, color="white", linewidth=0.55, alpha=0.8)
    draw_outlines(axes, drawn_parts(actuator, sample.distance_m), edge="white")
    bar = figure.colorbar(image, ax=axes, format="{x:g}", extend="max", pad=0.02)
    bar.set_ticks([limit * share for share in (0.0, 0.01, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)])
    bar.set_label(words("field", "flux_density"))
    return figure


def mesh_figure(point: SolvedPoint, title: str = "") -> Figure:
    """Draw the finite elements over the parts, in mm."""
    import ngsolve as ng

    figure, axes = _section(point.sample, title)
    _light_parts(axes, point.actuator, point.sample)
    r, z = MM * np.array([vertex.point for vertex in point.mesh.vertices]).T
    elements = np.array([[vertex.nr for vertex in element.vertices] for element in point.mesh.Elements(ng.VOL)])
    for side in (1.0, -1.0):
        axes.triplot(side * r, z, elements, color=INK, linewidth=0.35)
    counts = [f"{count:,}".replace(",", "\u2009") for count in (len(elements), point.unknowns)]
    _note(axes, words("mesh", "note", elements=counts[0], unknowns=counts[1]))
    return figure


def flux_lines_figure(actuator: Actuator, sample: FieldSample, title: str = "") -> Figure:
    """Draw flux lines over the parts, in mm."""
    figure, axes = _section(sample, title)
    _light_parts(axes, actuator, sample)
    draw_flux_lines(axes, sample, color=BLUE, linewidth=0.8)
    if flux := line_flux(sample):
        _note(axes, words("flux-lines", "note", flux=quantity(flux, "Wb")))
    return figure


def _section(sample: FieldSample, title: str) -> tuple[Figure, Axes]:
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


def point_title(sample: FieldSample) -> str:
    """The point and its force in words."""
    force = sample.force_N
    sense = words("point", "attracted" if force > 0.0 else "repelled") if force else ""
    distance = plain(MM * sample.distance_m, 4)
    current = " and ".join(plain(current, 4) for current in np.atleast_1d(sample.current_A))
    return words("point", "title", distance=distance, current=current, force=quantity(force, "N", 4), sense=sense)


def _light_parts(axes: Axes, actuator: Actuator, sample: FieldSample) -> None:
    parts = drawn_parts(actuator, sample.distance_m)
    draw_outlines(axes, parts, edge=INK, opacity=LIGHT)
    kinds = {drawn.kind for drawn in parts}
    handles = [
        axes.fill([], [], facecolor=COLOURS[kind], alpha=LIGHT, edgecolor=INK, label=words("kinds", kind))[0]
        for kind in COLOURS
        if kind in kinds
    ]
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.01, 1.0), handlelength=1.2)


def _note(axes: Axes, note: str) -> None:
    """Words below a picture."""
    look: dict[str, Any] = {"va": "top", "fontsize": 8, "color": MUTED, "backgroundcolor": PAPER}
    axes.annotate(note, (0.0, 0.0), (0, -34), xycoords="axes fraction", textcoords="offset points", **look)
