"""Moving the part without a new mesh: a stretch of the air along z.

Vertices of the moving part and its layer shift as one; the air above and the upper part of the gap below stretch
linearly, and the shift fades out with the radius. A mesh that changes smoothly makes errors that change smoothly: F(d)
has no remeshing jumps. The elements at the fixed parts' corners hold most of the energy's error and do not move, so
that it is the same at all distances: else it would show in d(flux linkage)/dd, which is often 1e-4 of the flux a mm.
"""

import numpy as np
from ngsolve import GridFunction, Mesh, VectorH1

from femfit.core.arrays import FloatArray
from femfit.fem.layout import Layout

STILL = 0.6  # of the gap above the fixed parts
FADE = 8.0  # the stretch has faded out at this multiple of the actuator's radius


def stretch(mesh: Mesh, layout: Layout, mover_bounds: tuple[float, float, float, float], shift: float) -> GridFunction:
    """Displacement of the mesh for a shift of the moving part.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        Made at a reference distance.
    layout : Layout
        Of the drawing.
    mover_bounds : (float, float, float, float)
        r_min, z_min, r_max, z_max of the moving part at the reference distance, in m.
    shift : float
        Along z, in m.

    Returns
    -------
    ngsolve.GridFunction
        For ``mesh.SetDeformation``; affine on every element, so straight edges stay straight.
    """
    points = np.array([vertex.point for vertex in mesh.vertices])
    space = VectorH1(mesh, order=1)
    displacement = GridFunction(space)
    along_z = displacement.components[1].vec.FV().NumPy()
    along_z[:] = shift * _profile(points, layout, mover_bounds)
    return displacement


def _profile(points: FloatArray, layout: Layout, mover_bounds: tuple[float, float, float, float]) -> FloatArray:
    """Share of the shift at points of shape (n, 2), between 0 and 1."""
    low = mover_bounds[1] - layout.outer_offset
    high = mover_bounds[3] + layout.outer_offset
    far = FADE * layout.radius
    still = layout.fixed_top + STILL * (low - layout.fixed_top)
    along = np.interp(points[:, 1], [still, low, high, far], [0.0, 1.0, 1.0, 0.0])
    across = np.interp(points[:, 0], [1.5 * layout.radius, far], [1.0, 0.0])
    return np.asarray(along * across)
