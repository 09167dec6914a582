"""Moving the part without a new mesh: a stretch of the air along z.

Vertices of the moving part and its layer shift as one; the air above and the upper part of the gap below stretch
linearly, and the shift fades out with the radius. A mesh that changes smoothly makes errors that change smoothly: F(d)
has no remeshing jumps. The elements at the fixed parts' corners hold most of the energy's error and do not move, so
that it is the same at all distances: else it would show in d(flux linkage)/dd, which is often 1e-4 of the flux a mm.
"""

import numpy as np
from ngsolve import H1, GridFunction, Mesh, VectorH1

from femfit.core.arrays import FloatArray
from femfit.field.layout import Layout

STILL = 0.6  # of the gap above the fixed parts
FADE = 8.0  # the stretch has faded out at this multiple of the actuator's radius


def stretch(mesh: Mesh, layout: Layout, layer_heights: tuple[float, float], shift: float) -> GridFunction:
    """Displacement of the mesh for a shift of the moving part.

    Parameters
    ----------
    layer_heights : (float, float)
        Lowest and highest z of the moving part's layer at the reference distance, in m.
    shift : float
        Along z, in m.
    """
    displacement = GridFunction(VectorH1(mesh, order=1))
    along_z = displacement.components[1].vec.FV().NumPy()
    along_z[:] = shift * stretch_share(mesh, layout, layer_heights).vec.FV().NumPy()
    return displacement


def stretch_share(mesh: Mesh, layout: Layout, layer_heights: tuple[float, float]) -> GridFunction:
    """Share of the moving part's shift that each place of the mesh makes: 1 at the part, 0 at the fixed ones."""
    share = GridFunction(H1(mesh, order=1))
    points = np.array([vertex.point for vertex in mesh.vertices])
    share.vec.FV().NumPy()[:] = _profile(points, layout, layer_heights)
    return share


def _profile(points: FloatArray, layout: Layout, layer_heights: tuple[float, float]) -> FloatArray:
    """Share of the shift at points of shape (n, 2), between 0 and 1."""
    low, high = layer_heights
    far = FADE * layout.radius
    still = layout.fixed_top + STILL * (low - layout.fixed_top)
    along = np.interp(points[:, 1], [still, low, high, far], [0.0, 1.0, 1.0, 0.0])
    across = np.interp(points[:, 0], [1.5 * layout.radius, far], [1.0, 0.0])
    return np.asarray(along * across)
