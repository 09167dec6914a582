"""|B| with flux lines over the full section."""

from typing import TYPE_CHECKING, Any

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.device.parts import Actuator
from femfit.report.actuator_figure import draw_outlines
from femfit.report.field_sample import FieldSample
from femfit.report.mirror import mirrored
from femfit.report.style import new_figure, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LINES = 18
"""Flux lines, each pair with the same flux between them."""

DECADES = 3.0
"""Of |B| shown in colour below its largest value."""

_NO_FIELD_T = 1e-6
"""Of an actuator without a magnet and without current."""

MM = 1e3


def colour_range(sample: FieldSample) -> tuple[float, float]:
    """Least and largest |B| of the colours, in T: whole steps of 1, 2 and 5.

    Returns
    -------
    tuple of float
        In T; up to a microtesla where there is no field at all.
    """
    top = max(float(np.percentile(sample.flux_density_T, 99.7)), _NO_FIELD_T)
    decade = 10.0 ** np.floor(np.log10(top))
    largest = next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= top)
    return float(largest / 10.0**DECADES), float(largest)


def flux_levels(flux: FloatArray) -> FloatArray:
    """Flux of the lines drawn.

    Parameters
    ----------
    flux : array
        2 pi r A_phi in Wb.

    Returns
    -------
    array
        Equally spaced, without zero, which is the axis; none where there is no flux.
    """
    low, high = min(float(flux.min()), 0.0), max(float(flux.max()), 0.0)
    if low == high:
        return np.zeros(0)
    step = (high - low) / (LINES + 1)
    levels = step * np.arange(np.ceil(low / step), np.floor(high / step) + 1)
    inside = (levels > low + 0.5 * step) & (levels < high - 0.5 * step) & (np.abs(levels) > 0.5 * step)
    return np.asarray(levels[inside])


def draw_flux_lines(axes: "Axes", sample: FieldSample, **line_style: Any) -> None:
    """Draw flux lines on the full section, in mm."""
    from contourpy import contour_generator

    x, flux = mirrored(sample.radius_m, sample.flux_Wb)
    contours = contour_generator(MM * x, MM * sample.height_m, flux)
    for level in flux_levels(sample.flux_Wb):
        for line in contours.lines(level):
            # As lines, not as one collection: matplotlib thins the points of lines only
            axes.plot(*np.asarray(line).T, **line_style)


@styled
def field_figure(actuator: Actuator, sample: FieldSample) -> "Figure":
    """Draw a field.

    Parameters
    ----------
    actuator : Actuator
        Whose outlines are drawn over it.

    Returns
    -------
    Figure
        |B| in colours (rasterised), flux lines, outlines.
    """
    from matplotlib.colors import LogNorm

    figure = new_figure(5.6, 6.2)
    axes = figure.subplots()
    x, density = mirrored(sample.radius_m, sample.flux_density_T)
    low, high = colour_range(sample)
    z = sample.height_m
    image = axes.imshow(
        np.clip(density, low, None),
        extent=(MM * x[0], MM * x[-1], MM * z[0], MM * z[-1]),
        origin="lower",
        norm=LogNorm(low, high),
        cmap="cividis",
        interpolation="bilinear",
    )
    draw_flux_lines(axes, sample, color="white", linewidth=0.55, alpha=0.8)
    draw_outlines(axes, actuator, sample.distance_m, edge="white")
    axes.set(xlabel="x (mm)", ylabel="z (mm)", xlim=(MM * x[0], MM * x[-1]), ylim=(MM * z[-1], MM * z[0]))
    axes.set_aspect("equal")
    axes.grid(visible=False)
    bar = figure.colorbar(image, ax=axes, shrink=0.85, extend="min")
    bar.set_label("|B| (T)")
    return figure
