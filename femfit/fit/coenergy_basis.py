"""The B-splines that a co-energy is made of."""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.bspline import basis_matrix

U_DEGREE = 4


@dataclass(frozen=True, eq=False)
class CoenergyBasis:
    """Degrees and knots of the spline.

    Parameters
    ----------
    reference_distance_m, distance_shift_m : float
        d_0 and s of u = d_0 / (d + s).
    """

    reference_distance_m: float
    distance_shift_m: float
    u_knots: FloatArray
    current_knots: FloatArray
    current_degree: int

    @property
    def shape(self) -> tuple[int, int]:
        """Number of basis functions in u and in i."""
        return len(self.u_knots) - U_DEGREE - 1, len(self.current_knots) - self.current_degree - 1

    @property
    def cells(self) -> tuple[int, int]:
        """Number of polynomial cells in u and in i."""
        return len(np.unique(self.u_knots)) - 1, len(np.unique(self.current_knots)) - 1

    def columns(self, distance: FloatArray, current: FloatArray, order: tuple[int, int]) -> FloatArray:
        """d^(a+b) W' / dd^a di^b of each basis function, shape (n, functions); a up to 2."""
        a, b = order
        shifted = distance + self.distance_shift_m
        u = self.reference_distance_m / shifted
        in_i = basis_matrix(current, self.current_knots, self.current_degree, b)

        def in_u(k: int) -> FloatArray:
            return basis_matrix(u, self.u_knots, U_DEGREE, k)

        slope = (-u / shifted)[:, None]
        if a == 0:
            part = in_u(0)
        elif a == 1:
            part = slope * in_u(1)
        else:
            part = slope**2 * in_u(2) + (2.0 * u / shifted**2)[:, None] * in_u(1)
        return (part[:, :, None] * in_i[:, None, :]).reshape(len(u), -1)

    def cell_points(self) -> tuple[FloatArray, FloatArray]:
        """Points (d, i) at three places of every cell in u and in the middle of every cell in i."""
        u, i = np.unique(self.u_knots), np.unique(self.current_knots)
        in_u = u[:-1, None] + np.diff(u)[:, None] * np.array([1.0, 3.0, 5.0]) / 6.0
        grid_u, grid_i = np.meshgrid(in_u.ravel(), 0.5 * (i[1:] + i[:-1]), indexing="ij")
        return self.reference_distance_m / grid_u.ravel() - self.distance_shift_m, grid_i.ravel()
