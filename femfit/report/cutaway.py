"""The actuator in three dimensions with a quarter cut away: |B| on the cut faces, flux lines in them.

Run as a module by :mod:`femfit.report.offscreen`, in a process of its own.
"""

import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from femfit.core.arrays import FloatArray
from femfit.device.parts import Actuator
from femfit.report.field_figure import colour_range, flux_levels
from femfit.report.field_sample import FieldSample
from femfit.report.kinds import COLOURS, HALL_COLOUR, kind_of
from femfit.report.mirror import Outline

MM = 1e3
SIZE = (1200, 1100)
CUT_DEGREES = 90.0
CUT_PLANES = (0.0, CUT_DEGREES)
SEGMENTS = 90
SUBDIVISIONS = 6
"""Of each triangle of a cut face, four parts each time."""


def draw_cutaway(actuator: Actuator, sample: FieldSample) -> Any:
    """Draw the cut-away with pyvista, which may end this process where it cannot draw.

    Returns
    -------
    array of uint8, shape (rows, columns, 3)
        The picture, without its white margins.
    """
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=SIZE)
    plotter.set_background("white")
    plotter.enable_anti_aliasing("ssaa")
    low, high = colour_range(sample)
    colours = {"cmap": "cividis", "clim": (low, high), "log_scale": True, "scalars": "B", "show_scalar_bar": False}
    parts = _parts(actuator, sample.distance_m)
    for outline, kind in parts:
        plotter.add_mesh(_revolved(outline), color=COLOURS[kind], ambient=0.35, diffuse=0.75)
    lines = _half_plane(sample).contour(flux_levels(sample.flux_Wb).tolist(), scalars="flux")
    faces = [_cut_face(outline, sample) for outline, _ in parts]
    for angle in CUT_PLANES:
        for face in faces:
            plotter.add_mesh(face.rotate_z(angle), lighting=False, **colours)
        shown = plotter.add_mesh(lines.rotate_z(angle), line_width=2.5, lighting=False, **colours)
    if actuator.hall is not None:
        place = (MM * actuator.hall.radius_m, 0.0, -MM * actuator.hall.height_m)
        plotter.add_mesh(pyvista.Sphere(0.02 * MM * float(sample.radius_m[-1]), place), color=HALL_COLOUR)
    return _picture(plotter, shown.mapper, sample)


def _parts(actuator: Actuator, distance: float) -> list[tuple[FloatArray, str]]:
    def corners(vertices: Outline, shift: float) -> FloatArray:
        return np.asarray(MM * (np.asarray(vertices) + np.array([0.0, shift])))

    parts = [(corners(r.vertices_m, 0.0), kind_of(r.material, moving=False)) for r in actuator.fixed]
    parts.append((corners(actuator.coil.vertices_m, 0.0), "winding"))
    parts += [(corners(r.vertices_m, distance), kind_of(r.material, moving=True)) for r in actuator.moving.regions]
    return parts


def _revolved(outline: FloatArray) -> Any:
    """The outline turned about the axis through all but the cut; z points down in the picture."""
    import pyvista

    closed = np.concatenate([outline, outline[:1]])
    points = np.stack([closed[:, 0], np.zeros(len(closed)), -closed[:, 1]], axis=1)
    line = pyvista.lines_from_points(points)
    body = line.extrude_rotate(resolution=SEGMENTS, angle=360.0 - CUT_DEGREES, capping=False)
    return body.rotate_z(CUT_DEGREES)


def _cut_face(outline: FloatArray, sample: FieldSample) -> Any:
    """A part's section with |B| at the corners of small triangles."""
    import pyvista

    corners = np.stack([outline[:, 0], np.zeros(len(outline)), -outline[:, 1]], axis=1)
    face = pyvista.PolyData(corners, faces=[len(corners), *range(len(corners))]).triangulate().subdivide(SUBDIVISIONS)
    field = RegularGridInterpolator((sample.height_m, sample.radius_m), sample.flux_density_T)
    face["B"] = field(np.stack([-face.points[:, 2], face.points[:, 0]], axis=1) / MM)
    return face


def _half_plane(sample: FieldSample) -> Any:
    import pyvista

    r, z = np.meshgrid(MM * sample.radius_m, MM * sample.height_m)
    grid = pyvista.StructuredGrid(r[:, None, :], np.zeros_like(r)[:, None, :], -z[:, None, :])
    for name, values in (("B", sample.flux_density_T), ("flux", sample.flux_Wb)):
        grid[name] = values[:, None, :].ravel(order="F")
    return grid


def _picture(plotter: Any, mapper: Any, sample: FieldSample) -> Any:
    plotter.add_scalar_bar(
        title="B (T)\n",
        mapper=mapper,
        vertical=True,
        position_x=0.88,
        position_y=0.25,
        width=0.05,
        height=0.5,
        color="black",
        n_labels=4,
        fmt="%.3g",
        title_font_size=26,
        label_font_size=24,
    )
    middle = -0.5 * MM * (sample.height_m[0] + sample.height_m[-1])
    size = MM * (sample.height_m[-1] - sample.height_m[0])
    plotter.camera.parallel_projection = True
    plotter.camera.focal_point = (0.0, 0.0, middle)
    plotter.camera.position = (3.0 * size, 2.2 * size, middle + 1.6 * size)
    plotter.camera.up = (0.0, 0.0, 1.0)
    plotter.camera.parallel_scale = 0.56 * size
    plotter.reset_camera_clipping_range()
    image = plotter.screenshot(return_img=True)
    plotter.close()
    return cropped(image)


def cropped(image: Any) -> Any:
    """A picture without its white margins.

    Parameters
    ----------
    image : array of uint8, shape (rows, columns, 3)
        On white.

    Returns
    -------
    array
        A part of it, with a few pixels of margin.
    """
    drawn = (image < 250).any(axis=2)
    rows, columns = (np.flatnonzero(drawn.any(axis=axis)) for axis in (1, 0))
    top, left = max(rows[0] - 8, 0), max(columns[0] - 8, 0)
    return image[top : rows[-1] + 9, left : columns[-1] + 9]


def main(task: Path, image: Path) -> None:
    """Draw what a task file holds.

    Parameters
    ----------
    task : Path
        Pickled (actuator, sample), written by :mod:`femfit.report.offscreen`.
    image : Path
        Of the PNG file to write.
    """
    from matplotlib.image import imsave

    imsave(image, draw_cutaway(*pickle.loads(task.read_bytes())))  # noqa: S301 - our own parent wrote it


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
