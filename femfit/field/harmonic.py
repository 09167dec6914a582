"""The field at a complex frequency s, with eddy currents in the parts that conduct: (K + s M) w = sources.

K and M are symmetric, so with w_k of 1 A in circuit k the inductances are L_jk(s) = load_j . w_k = L_kj(s), and the
windings' impedances R + s L(s). At s = j omega the form is complex symmetric; at real s > 0 it is positive definite.
The loss checks it: the real part of j omega L is the power of the eddy currents by 1 A, the integral of
sigma omega^2 r^2 |w|^2 2 pi r.

An electric field -r dw/dt along phi drives sigma r^2 dw/dt in a solid part, so that the field's equations are
K w + M dw/dt = sources with

    M = integral sigma r^2 w v 2 pi r            of solid parts,
    M = integral (sigma b^2 / 12) B(w) . B(v) 2 pi r   of stacks of sheets of the thickness b along B.

The second is the first term of homogenisation: no current crosses from sheet to sheet, and within a sheet B is taken as
even, which holds where b is not above the skin depth. Windings are of thin strands, without eddy currents of their own.

Induced currents are kept as values at the quadrature points of the parts that conduct, the same on every mesh. With the
rows c of a field w at the points, sqrt(sigma) r w in solid parts and sqrt(sigma b^2 / 12) B(w) in stacks of sheets, M
is the sum of weight c c: a field's rows tell the induced current that goes with it, whatever the mesh that it was
solved on. Parts move as rigid bodies, so that a row belongs to a place in its part.

References
----------
C. V. Dodd and W. E. Deeds, J. Appl. Phys. 39 (1968) 2829: a coil above a conductor, in closed form.
R. L. Stoll, The Analysis of Eddy Currents (Clarendon, 1974), chapters 2 (skin depth) and 4 (sheets).
J. Gyselinck, L. Vandevelde, J. Melkebeek and P. Dular, IEEE Trans. Magn. 38 (2002) 1133: homogenised sheets.
"""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import ngsolve as ng
import numpy as np
import shapely
from ngsolve import H1, BilinearForm, InnerProduct, dx
from scipy import sparse
from scipy.sparse.linalg import splu

from femfit.core.numerics import MU_0, FloatArray
from femfit.device.parts import Actuator, Material, Region, skin_depth
from femfit.field.layout import AIR, polygon
from femfit.field.material_points import MaterialPoints, QuadraturePoints
from femfit.field.nonlinear_system import SummedInverse
from femfit.field.weak_form import (
    RADIAL_WEIGHT_ORDER,
    FieldArray,
    flux_density,
    function_of,
    materials,
    stiffness,
)

if TYPE_CHECKING:
    from femfit.field.moving_mesh import MovingMesh

LAYER_DEPTHS = 2.0
"""Numerical: of the outermost layer of elements over the skin depth, at most."""

LAYER_FACTOR = 0.25
"""Numerical: of one layer's thickness over the next one's. At order 4 the impedances beside a plate, a rod and a ball
of steel are met to 0.08 % at any frequency; with 0.15 to 0.6 %, for a tenth fewer unknowns, since what lies below the
outermost layer is then one element of up to six skin depths."""

MOST_LAYERS = 6


def conductors(actuator: Actuator) -> dict[str, Material]:
    """Material of each of the mesh's region names that conducts."""
    return {name: material for name, material in materials(actuator).items() if material.conductivity_S_per_m}


def add_eddy_form(form: BilinearForm, named: Mapping[str, Material], factor: Any = 1.0) -> None:
    """Add M of the named conductors, times a factor, to a form that is not assembled yet."""
    w, v = form.space.TnT()
    for name, material in named.items():
        density = ng.x**2 * w * v
        if material.lamination_m:
            density = material.lamination_m**2 / 12.0 * InnerProduct(flux_density(w), flux_density(v))
        measure = dx(name, bonus_intorder=RADIAL_WEIGHT_ORDER)
        form += factor * material.conductivity_S_per_m * density * 2.0 * math.pi * ng.x * measure


def skin_layers(region: Region, largest_element: float, frequency_Hz: float) -> int:
    """How often the elements at a part's surface are to be split so that the field's decay is resolved."""
    material = region.material
    if not material.conductivity_S_per_m or material.lamination_m or not frequency_Hz:
        return 0
    outline = polygon(region)
    element = min(largest_element, 2.0 * outline.area / shapely.length(outline))
    ratio = LAYER_DEPTHS * skin_depth(material, frequency_Hz) / element
    return min(MOST_LAYERS, max(0, math.ceil(math.log(ratio) / math.log(LAYER_FACTOR))))


class HarmonicSystem:
    """The forms on one mesh, for real s or for complex ones.

    Where parts saturate, they are those of small fields about the state whose tangent ``points`` was last set to.
    """

    def __init__(self, moving: "MovingMesh", actuator: Actuator, points: MaterialPoints, *, real: bool = False) -> None:
        self.space = H1(moving.mesh, order=points.space.globalorder, complex=not real)
        self._air = stiffness(self.space, ng.CF(1.0 / MU_0), moving.layout.outer_radius, regions=AIR)
        self._frequency = ng.Parameter(1.0) if real else ng.ParameterC(1.0)
        self._solid = points.tangent_on(self.space)
        add_eddy_form(self._solid, conductors(actuator), self._frequency)
        self._inverse = SummedInverse(self.space)

    def move(self) -> None:
        """Take the mesh as it is now stretched."""
        self._air.Assemble()

    def solve(self, frequency: complex, loads: FloatArray) -> FieldArray:
        """Solve at s in 1/s for loads (k, unknowns), on the mesh as last taken; the same shape."""
        self._frequency.Set(frequency)
        self._solid.Assemble()
        self._inverse.renew((self._air, self._solid))
        return self._inverse.solve_all(loads)


class ConductorPoints:
    """Points of the conducting parts on one mesh and space, made with the moving part at a distance in m."""

    def __init__(self, space: H1, actuator: Actuator, distance: float) -> None:
        self.space, self.distance = space, distance
        named = conductors(actuator)
        self._points = QuadraturePoints(space.mesh, space.globalorder + 1, "|".join(named))
        parts = space.mesh.MaterialCF({name: float(k) for k, name in enumerate(named)}, default=0.0)
        of_part, filling = self._points.values(parts).round().astype(np.int64), list(named.values())
        sheet = np.array([material.lamination_m for material in filling])
        conductivity = np.array([material.conductivity_S_per_m for material in filling])
        self.moving = np.array([name.startswith("moving") for name in named], dtype=np.bool_)[of_part]
        self.sheets = (sheet > 0.0)[of_part]
        self.factor = (np.where(sheet > 0.0, sheet / math.sqrt(12.0), 1.0) * np.sqrt(conductivity))[of_part]
        r, z = self._points.values(ng.x), self._points.values(ng.y)
        self.places = np.column_stack([r, z - distance * self.moving])
        weight = 2.0 * math.pi * r * self._points.weight
        self.weight = np.concatenate([weight, weight[self.sheets]])
        names = [material.name for material in filling]
        places = list(dict.fromkeys(names))
        of_material = np.array([places.index(name) for name in names], dtype=np.int64)[of_part]
        self.material_rows = np.concatenate([of_material, of_material[self.sheets]])  # Which of the materials
        self.moving_rows = np.concatenate([self.moving, self.moving[self.sheets]])
        w, factor = space.TrialFunction(), sparse.diags(self.factor)
        b = flux_density(w)
        self._map = factor @ self._points.map_of(space, ng.x * w)
        if self.sheets.any():
            along, across = (factor @ self._points.map_of(space, component) for component in (b[0], b[1]))
            of_sheets = sparse.diags(self.sheets.astype(np.float64))
            first = self._map - of_sheets @ self._map + of_sheets @ along
            self._map = sparse.vstack([first, across[self.sheets]]).tocsr()
        self._to_load = self._map.T.tocsr()

    def rows(self, states: FloatArray) -> FloatArray:
        """Rows (k, n) of fields (k, unknowns)."""
        return np.asarray((self._map @ states.T).T)

    def products(self, rows: FloatArray) -> FloatArray:
        """Power of rows (k, n) with each other, shape (k, k)."""
        return np.asarray((self.weight * rows) @ rows.T)

    def loads(self, rows: FloatArray, *, moving: bool = False) -> FloatArray:
        """Right-hand sides (k, unknowns) of the currents that go with rows (k, n), or of those that move."""
        weight = self.weight * self.moving_rows if moving else self.weight
        return np.asarray((self._to_load @ (weight * rows).T).T)

    def rows_of(self, states: FloatArray, space: H1, distance: float) -> FloatArray:
        """Rows (k, n) of fields (k, unknowns) on another mesh, which was made with the moving part at a distance."""
        points = space.mesh(self.places[:, 0], self.places[:, 1] + distance * self.moving)
        result = []
        for state in states:
            function = function_of(space, state)
            rows = self.factor * self.places[:, 0] * function(points)[:, 0]
            if self.sheets.any():
                b = self.factor[:, None] * flux_density(function)(points)
                rows = np.concatenate([np.where(self.sheets, b[:, 0], rows), b[self.sheets, 1]])
            result.append(rows)
        return np.array(result)

    def fields(self, rows: FloatArray) -> FloatArray:
        """The fields (k, unknowns) on the conducting parts that have rows (k, n), by least squares."""
        mass = (self._to_load @ sparse.diags(self.weight) @ self._map).tocsc()
        inside = np.flatnonzero(mass.diagonal() > 0.0)
        result = np.zeros((len(rows), self.space.ndof))
        result[:, inside] = splu(mass[inside][:, inside]).solve(self.loads(rows).T[inside]).T
        return result
