r"""The field at a complex frequency s: (K + s M) w = sources, with M of :mod:`femfit.field.conductors`.

K and M are symmetric, so with w_k of 1 A in circuit k the inductances are L_jk(s) = load_j . w_k = L_kj(s), and the
windings' impedances R + s L(s). At s = j omega the form is complex symmetric; at real s > 0 it is positive definite.
The loss checks it: the real part of j omega L is the power of the eddy currents by 1 A, the integral of
sigma omega^2 r^2 |w|^2 2 pi r.

References
----------
C. V. Dodd and W. E. Deeds, J. Appl. Phys. 39 (1968) 2829: a coil above a conductor, in closed form.
"""

from collections.abc import Sequence
from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import H1, BilinearForm, Mesh
from numpy.typing import NDArray

from femfit.core.arrays import FloatArray
from femfit.core.constants import MU_0
from femfit.device.parts import Actuator
from femfit.field.conductors import add_eddy_form, conductors
from femfit.field.layout import Layout
from femfit.field.linear_system import SummedInverse
from femfit.field.material_points import MaterialPoints
from femfit.field.regions import AIR
from femfit.field.weak_form import linear_materials, materials, reluctivity, stiffness

FieldArray = NDArray[Any]
"""Coefficients of fields, real at real s and complex else."""


class HarmonicSystem:
    """The forms on one mesh, for real s or for complex ones.

    Where parts saturate, they are those of small fields about a state: ``points`` holds nu_d there, as last set.
    """

    def __init__(
        self,
        mesh: Mesh,
        actuator: Actuator,
        layout: Layout,
        order: int,
        *,
        real: bool = False,
        points: MaterialPoints | None = None,
    ) -> None:
        self.space = H1(mesh, order=order, complex=not real)
        named, conducting = materials(actuator), conductors(actuator)
        self._air = stiffness(self.space, ng.CF(1.0 / MU_0), layout.outer_radius, regions=AIR)
        self._frequency = ng.Parameter(1.0) if real else ng.ParameterC(1.0)
        self._still: list[BilinearForm] = []
        if points is not None:
            self._renewed = [points.tangent_on(self.space)]
        else:
            nu = reluctivity(mesh, linear_materials(actuator))
            still = "|".join(name for name in named if name not in conducting)
            if still:
                self._still = [stiffness(self.space, nu, None, regions=still).Assemble()]
            self._renewed = [stiffness(self.space, nu, None, regions="|".join(conducting))] if conducting else []
        if conducting:
            add_eddy_form(self._renewed[0], conducting, self._frequency)
        self._inverse = SummedInverse(self.space)

    def move(self) -> None:
        """Take the mesh as it is now stretched."""
        self._air.Assemble()

    def solve(self, frequency: complex, loads: Sequence[FloatArray] | FloatArray) -> FieldArray:
        """Solve at s in 1/s for loads (k, unknowns), on the mesh as last taken; the same shape."""
        self._frequency.Set(frequency)
        for form in self._renewed:
            form.Assemble()
        self._inverse.renew((self._air, *self._still, *self._renewed))
        return np.array([self._inverse.solve(load) for load in loads]).reshape(len(loads), self.space.ndof)
