r"""The force once more, by the reaction on the fixed parts and by virtual work: what the mover's force is held against.

With the total field u + v (u of the moving part's magnetisation alone, v of all the rest;
:mod:`femfit.field.linear_system`) the force is the mutual stress 2 T(u, v), weighted by any function g that is 1 on the
moving part and 0 on the fixed ones. The stress of either field with itself integrates to zero and is left out. On a
mesh it does not: round the corners of a core it was found up to fifty times the error of the mover's force, whose layer
touches no corner. That is why the plain reaction is the worse number, and no measure of the better one.

**Reaction.** g is harmonic in all air, down to the surfaces of the fixed parts.

**Virtual work.** Weighted by g, the stress is the derivative of the discrete co-energy as the mesh moves by g. With the
sweep's own stretch as g, 2 T(u, v) is the slope of the fields' mutual co-energy along the table's distances: what
differences of neighbouring rows would give, without their rounding, and without the slope of each field's own energy,
which is error. Where each distance has a mesh of its own, all air moves with the part as for the reaction.

Neither has its weight in the layer of the mover's force. All three share the error of the magnetisation, which only the
change between two orders measures; the disagreement says what is left beside it.

References
----------
J. L. Coulomb, IEEE Trans. Magn. 19 (1983) 2514: virtual work on a mesh; F. Henrotte, G. Deliege and K. Hameyer, COMPEL
23 (2004) 496: its equality with the weighted stress.
"""

import numpy as np
from ngsolve import CF, GridFunction, Integrate, grad

from femfit.core.arrays import FloatArray
from femfit.field.linear_system import FieldPair
from femfit.field.stress import AROUND_FIXED, stress_density
from femfit.field.weak_form import flux_density


class OtherForces:
    """Reaction and virtual work of a linear actuator's fields, as functions on one mesh.

    The two are integrated for the three coefficients of 1, i and i^2 alone; to assemble their matrices at each distance
    would take four times as long.

    Parameters
    ----------
    total, own : FieldPair
        w and u; their values are read when :meth:`evaluate` is called.
    reaction_weight, work_weight : ngsolve.GridFunction
        Both vary in the air outside of the mover's layer alone.
    """

    def __init__(
        self, total: FieldPair, own: FieldPair, reaction_weight: GridFunction, work_weight: GridFunction
    ) -> None:
        space = total.coil.space
        self._mesh = space.mesh
        self._order = 2 * space.globalorder + 2  # B, B, r and the slope of a weight of order 2
        w, u = ([flux_density(function) for function in (pair.magnets, pair.coil)] for pair in (total, own))
        v = [b - own_b for b, own_b in zip(w, u, strict=True)]
        pairs = [(u[0], v[0]), (u[0], v[1]), (u[1], v[0]), (u[1], v[1])]
        slopes = grad(reaction_weight), grad(work_weight)
        terms = [2.0 * stress_density(b, c, slope) for slope in slopes for b, c in pairs]
        self._density = CF(tuple(terms)).Compile()  # each field is evaluated once, not in every term

    def evaluate(self) -> tuple[FloatArray, FloatArray]:
        """The reaction's and virtual work's coefficients of 1, i and i^2, each of shape (3,), signed as the force."""
        air = self._mesh.Materials(AROUND_FIXED.region)
        terms = np.array(Integrate(self._density, self._mesh, order=self._order, definedon=air)).reshape(2, 4)
        reaction, work = np.column_stack([terms[:, 0], terms[:, 1] + terms[:, 2], terms[:, 3]])
        return reaction, work
