"""Pictures and a ParaView file of one point, as ``femfit view`` asks for them."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from femfit.core.atomic import replacing
from femfit.report.actuator_figure import actuator_figure
from femfit.report.field_cells import field_cells
from femfit.report.field_sample import FieldSample, sample_of
from femfit.report.solved_point import SolvedPoint
from femfit.report.style import style
from femfit.report.view_figures import (
    flux_density_figure,
    flux_lines_figure,
    mesh_figure,
    permeability_figure,
    titled,
)
from femfit.report.vtu import write_vtu

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURES = ("geometry", "mesh", "flux-lines", "flux-density", "permeability")
VTU = "vtu"
DPI = 170


def write_views(point: SolvedPoint, files: Sequence[tuple[str, Path]]) -> FieldSample:
    """Draw a point.

    Parameters
    ----------
    files : sequence of (str, Path)
        What to draw, of :data:`PICTURES` or ``vtu``, and the file; its suffix names the format of a picture (png, svg,
        pdf).

    Returns
    -------
    FieldSample
        With the point, its force and the largest |B| of each part.
    """
    actuator, sample, cells = point.actuator, sample_of(point), field_cells(point)
    draw: dict[str, Callable[[], Figure]] = {
        "geometry": lambda: titled(actuator_figure(actuator, point.distance_m), actuator, sample, "geometry"),
        "mesh": lambda: mesh_figure(actuator, sample, cells),
        "flux-lines": lambda: flux_lines_figure(actuator, sample),
        "flux-density": lambda: flux_density_figure(actuator, sample, cells),
        "permeability": lambda: permeability_figure(actuator, sample, cells),
    }
    for what, path in files:
        if what == VTU:
            write_vtu(point, cells, path)
            continue
        with style(), replacing(path) as partial:
            draw[what]().savefig(partial, dpi=DPI, bbox_inches="tight")
    return sample
