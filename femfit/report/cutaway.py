"""The actuator in three dimensions with a quarter cut away: |B| on the cut faces, flux lines in them.

It is drawn in a child process that runs this file as a module, without a screen where there is none. VTK ends the whole
process with a segmentation fault where neither EGL nor OSMesa is there: that costs one picture, and the report says so.
"""

import pickle
import subprocess
import sys
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from femfit.core.numerics import FloatArray
from femfit.device.parts import Actuator
from femfit.report.drawing import COLOURS, HALL_COLOUR, drawn_parts
from femfit.report.field_figures import colour_limit, flux_levels
from femfit.report.field_sample import FieldSample
from femfit.report.style import new_figure, style, words

MM = 1e3
SIZE = (1200, 1100)
CUT_DEGREES = 90.0
CUT_PLANES = (0.0, CUT_DEGREES)
SEGMENTS = 90
SUBDIVISIONS = 6
"""How often each triangle of a cut face is divided into four."""

TIMEOUT_S = 60.0
"""For a picture that takes 3 to 5 s on a free machine, most of it the import of VTK."""


def draw_off_screen(actuator: Actuator, sample: FieldSample, timeout: float = TIMEOUT_S) -> tuple[bytes | None, str]:
    """Draw the cut-away in a child process: a PNG file, or None and why there is none."""
    command = [sys.executable, "-m", "femfit.report.cutaway"]
    task = pickle.dumps((actuator, sample))
    try:
        child = subprocess.run(command, input=task, capture_output=True, timeout=timeout, check=False)  # noqa: S603 - our own
    except subprocess.TimeoutExpired:
        return None, f"no picture within {timeout:g} s"
    if child.returncode < 0:
        return None, f"the process that draws was killed by signal {-child.returncode}"
    if child.returncode or not child.stdout.startswith(b"\x89PNG"):
        return None, f"the process that draws ended with code {child.returncode} and no picture"
    return child.stdout, ""


def _draw_cutaway(actuator: Actuator, sample: FieldSample) -> Any:
    """The cut-away as an array of uint8, shape (rows, columns, 3); VTK may end this process where it cannot draw."""
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=SIZE)
    plotter.set_background("white")
    plotter.enable_anti_aliasing("ssaa")
    # VTK knows no square root of colours: it is given the root itself
    limit = float(np.sqrt(colour_limit(sample)))
    colours = {"cmap": "cividis", "clim": (0.0, limit), "scalars": "root_B", "show_scalar_bar": False}
    parts = [(MM * drawn.corners, drawn.kind) for drawn in drawn_parts(actuator, sample.distance_m)]
    for outline, kind in parts:  # turned about the axis through all but the cut; z points down in the picture
        closed = np.concatenate([outline, outline[:1]])
        line = pyvista.lines_from_points(np.stack([closed[:, 0], np.zeros(len(closed)), -closed[:, 1]], axis=1))
        body = line.extrude_rotate(resolution=SEGMENTS, angle=360.0 - CUT_DEGREES, capping=False)
        plotter.add_mesh(body.rotate_z(CUT_DEGREES), color=COLOURS[kind], ambient=0.35, diffuse=0.75)
    r, z = np.meshgrid(MM * sample.radius_m, MM * sample.height_m)
    half_plane = pyvista.StructuredGrid(r[:, None, :], np.zeros_like(r)[:, None, :], -z[:, None, :])
    for name, values in (("root_B", np.sqrt(sample.flux_density_T)), ("flux", sample.flux_Wb)):
        half_plane[name] = values[:, None, :].ravel(order="F")
    lines = half_plane.contour(flux_levels(sample.flux_Wb).tolist(), scalars="flux")
    faces = [_cut_face(outline, sample) for outline, _ in parts]
    for angle in CUT_PLANES:
        for face in faces:
            plotter.add_mesh(face.rotate_z(angle), lighting=False, **colours)
        plotter.add_mesh(lines.rotate_z(angle), line_width=2.5, lighting=False, **colours)
    if actuator.hall is not None:
        place = (MM * actuator.hall.radius_m, 0.0, -MM * actuator.hall.height_m)
        plotter.add_mesh(pyvista.Sphere(radius=0.02 * MM * float(sample.radius_m[-1]), center=place), color=HALL_COLOUR)
    return _picture(plotter, sample)


def _cut_face(outline: FloatArray, sample: FieldSample) -> Any:
    """A part's section with |B| at the corners of small triangles."""
    import pyvista

    corners = np.stack([outline[:, 0], np.zeros(len(outline)), -outline[:, 1]], axis=1)
    face = pyvista.PolyData(corners, faces=[len(corners), *range(len(corners))]).triangulate().subdivide(SUBDIVISIONS)
    field = RegularGridInterpolator((sample.height_m, sample.radius_m), sample.flux_density_T)
    face["root_B"] = np.sqrt(field(np.stack([-face.points[:, 2], face.points[:, 0]], axis=1) / MM))
    return face


def _picture(plotter: Any, sample: FieldSample) -> Any:
    """What the camera sees, without white margins."""
    from PIL import Image

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
    columns, rows = np.reshape(Image.fromarray(255 - image).getbbox() or (0, 0, *SIZE), (2, 2)).T
    return image[slice(*rows), slice(*columns)]


def _save_with_bar(image: Any, sample: FieldSample, file: Any) -> None:
    """Write a picture beside its colour bar, which covers nothing of it."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import PowerNorm

    rows, columns = image.shape[:2]
    with style():
        figure = new_figure(6.0, 6.0 * columns / rows + 0.9)
        axes = figure.subplots()
        axes.imshow(image, interpolation="none")
        axes.axis("off")
        colours = ScalarMappable(PowerNorm(0.5, 0.0, colour_limit(sample)), "cividis")
        bar = figure.colorbar(colours, ax=axes, shrink=0.6, pad=0.02, extend="max", format="{x:g}")
        bar.set_ticks([colour_limit(sample) * share for share in (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 1.0)])
        bar.set_label(words("field", "flux_density"))
        figure.savefig(file, dpi=rows / 6.0, format="png")


if __name__ == "__main__":
    drawing, field = pickle.load(sys.stdin.buffer)  # noqa: S301 - our own parent wrote it
    _save_with_bar(_draw_cutaway(drawing, field), field, sys.stdout.buffer)
