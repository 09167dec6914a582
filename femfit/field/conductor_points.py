r"""Induced currents as values at the quadrature points of the parts that conduct, the same on every mesh.

With the rows c of a field w at the points, sqrt(sigma) r w in solid parts and sqrt(sigma b^2 / 12) B(w) in stacks of
sheets, M of :mod:`femfit.field.conductors` is the sum of weight c c: a field's rows tell the induced current that goes
with it, whatever the mesh that it was solved on. Parts move as rigid bodies, so that a row belongs to a place in its
part.
"""

import math
from typing import Any

import ngsolve as ng
import numpy as np
from ngsolve import H1, BilinearForm, GridFunction, LinearForm, dx
from ngsolve.comp import IntegrationRuleSpace
from scipy import sparse
from scipy.sparse.linalg import splu

from femfit.core.arrays import FloatArray
from femfit.device.parts import Actuator
from femfit.field.conductors import conductors
from femfit.field.material_points import csr
from femfit.field.weak_form import flux_density


class ConductorPoints:
    """Points of the conducting parts on one mesh and space, made with the moving part at a distance in m."""

    def __init__(self, space: H1, actuator: Actuator, distance: float) -> None:
        self.space, self.distance = space, distance
        self._named = conductors(actuator)
        region = space.mesh.Materials("|".join(self._named))
        self._points = IntegrationRuleSpace(space.mesh, order=space.globalorder + 1, definedon=region)
        self._measure = dx("|".join(self._named), intrules=self._points.GetIntegrationRules())
        self.moving = self._sampled({"moving:.*": 1.0}) > 0.5
        self.sheets = self._sampled({n: float(m.lamination_m > 0.0) for n, m in self._named.items()}) > 0.5
        thickness = {n: m.lamination_m / math.sqrt(12.0) or 1.0 for n, m in self._named.items()}
        self.factor = self._sampled(
            {n: thickness[n] * math.sqrt(m.conductivity_S_per_m) for n, m in self._named.items()}
        )
        q = self._points.TestFunction()
        measure = LinearForm(self._points)
        measure += q * self._measure
        area = np.array(measure.Assemble().vec.FV().NumPy())
        self.places = np.column_stack([self._interpolated(ng.x), self._interpolated(ng.y) - distance * self.moving])
        weight = 2.0 * math.pi * self.places[:, 0] * area
        self.weight = np.concatenate([weight, weight[self.sheets]])
        places = {name: float(k) for k, name in enumerate(dict.fromkeys(one.name for one in self._named.values()))}
        of_material = self._sampled({n: places[m.name] for n, m in self._named.items()}).round().astype(np.int64)
        self.material_rows = np.concatenate([of_material, of_material[self.sheets]])  # Which of the materials
        self.moving_rows = np.concatenate([self.moving, self.moving[self.sheets]])
        self._map = self._rows_map(area)
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
        at = space.mesh(self.places[:, 0], self.places[:, 1] + distance * self.moving)
        function, result = GridFunction(space), []
        for state in states:
            function.vec.FV().NumPy()[:] = state
            rows = self.factor * self.places[:, 0] * function(at)[:, 0]
            if self.sheets.any():
                b = self.factor[:, None] * flux_density(function)(at)
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

    def _sampled(self, of_regions: dict[str, float]) -> FloatArray:
        return self._interpolated(self.space.mesh.MaterialCF(of_regions, default=0.0))

    def _interpolated(self, values: Any) -> FloatArray:
        function = GridFunction(self._points)
        function.Interpolate(values)
        return np.array(function.vec.FV().NumPy())

    def _rows_map(self, area: FloatArray) -> Any:
        w = self.space.TrialFunction()
        b = flux_density(w)
        current = self._component(ng.x * w, area)
        if not self.sheets.any():
            return current
        along, across = self._component(b[0], area), self._component(b[1], area)
        sheets = sparse.diags(self.sheets.astype(np.float64))
        first = current - sheets @ current + sheets @ along
        return sparse.vstack([first, across[self.sheets]]).tocsr()

    def _component(self, value: Any, area: FloatArray) -> Any:
        form = BilinearForm(trialspace=self.space, testspace=self._points)
        form += value * self._points.TestFunction() * self._measure
        return sparse.diags(self.factor / area) @ csr(form.Assemble().mat, self.space.ndof)
