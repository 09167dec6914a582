"""The co-energy of circuits and eddy currents together, from the static one by the chain rule.

With w = (i, e), G = (1, C), u = G w, phi = dW_s/du, L = d^2 W_s/du^2 and a dash for the derivative in d:

    dW'/dw = G^T phi + (0, lambda + Q e),    d^2 W'/dw^2 = G^T L G + (0, Q),
    dW'/dd = dW_s/dd + phi . u' + lambda' . e + e^T Q' e / 2,    u' = C' e,

and so on for the slopes that Jacobians need.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.model.eddy_currents import EddyCurrents, EddyForms
from femfit.model.magnetics import Magnetics, MagneticSlopes, MagneticState, OneCurrentMagnetics


@dataclass(frozen=True, eq=False)
class EddyMagnetics(Magnetics):
    """W'(d, i, e) of the module's head; currents are (i_1..i_n, e_1..e_r)."""

    static: Magnetics
    eddy: EddyCurrents

    @property
    def names(self) -> tuple[str, ...]:
        """Of the circuits, then of the patterns."""
        return (*self.eddy.circuits, *self.eddy.names)

    def coenergy(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """W' in J, up to a constant, of shape (...)."""
        (at,), w = self.eddy.whole_forms(distance), np.asarray(currents, dtype=np.float64)
        static = self.static.coenergy(distance, _times(at.coupling, w))
        return np.asarray(static + ((at.flux_linkage + 0.5 * _times(at.inductance, w)) * w).sum(axis=-1))

    def flux_linkage(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """dW'/dw in Wb, of shape (..., n + r)."""
        (at,), w = self.eddy.whole_forms(distance), np.asarray(currents, dtype=np.float64)
        phi = self.static.flux_linkage(distance, _times(at.coupling, w))
        return _transposed(at.coupling, phi) + at.flux_linkage + _times(at.inductance, w)

    def state(self, distance: FloatArray, currents: FloatArray) -> MagneticState:
        """Force (...), motional constants (..., n + r) and inductances (..., n + r, n + r) together."""
        (at, rising), w = self.eddy.whole_forms(distance, 0, 1), np.asarray(currents, dtype=np.float64)
        u = _times(at.coupling, w)
        if isinstance(self.static, OneCurrentMagnetics) and self.eddy.circuits:  # all four from one evaluation
            orders = ((1, 0), (0, 1), (1, 1), (0, 2))
            slope, phi, mixed, curved = self.static.coenergy_derivatives(distance, u[..., 0], orders)
            found = MagneticState(-slope, -mixed[..., None], curved[..., None, None])
            return with_eddies(at, rising, w, found, phi[..., None])
        return with_eddies(at, rising, w, self.static.state(distance, u), self.static.flux_linkage(distance, u))

    def slopes(self, distance: FloatArray, currents: FloatArray) -> MagneticSlopes:
        """The slopes of all currents."""
        (at, rising, bent), w = self.eddy.whole_forms(distance, 0, 1, 2), np.asarray(currents, dtype=np.float64)
        u, u_1, u_2 = (_times(one.coupling, w) for one in (at, rising, bent))
        part, phi = self.static.slopes(distance, u), self.static.flux_linkage(distance, u)
        inductance, along = part.inductance, np.einsum("...jkl,...l->...jk", part.inductance_slope, u_1)
        # The first and second derivatives of phi in d at held w
        risen = _times(inductance, u_1) - part.motional_constant
        bending = _times(2.0 * part.inductance_gradient + along, u_1) - part.motional_gradient
        bending = bending + _times(inductance, u_2)
        further = _times(bent.inductance, w)
        second = (
            ((risen - part.motional_constant) * u_1 + phi * u_2).sum(axis=-1)
            + ((bent.flux_linkage + 0.5 * further) * w).sum(axis=-1)
            - part.force_gradient
        )
        motional_gradient = -(
            _transposed(bent.coupling, phi)
            + 2.0 * _transposed(rising.coupling, risen)
            + _transposed(at.coupling, bending)
            + bent.flux_linkage
            + further
        )
        g = at.coupling
        half = np.swapaxes(rising.coupling, -1, -2) @ inductance @ g
        gradient = half + np.swapaxes(half, -1, -2) + np.swapaxes(g, -1, -2) @ (part.inductance_gradient + along) @ g
        state = with_eddies(at, rising, w, MagneticState(part.force, part.motional_constant, inductance), phi)
        return MagneticSlopes(
            motional_constant=state.motional_constant,
            inductance=state.inductance,
            force=state.force,
            force_gradient=-second,
            motional_gradient=motional_gradient,
            inductance_gradient=gradient + rising.inductance,
            inductance_slope=np.einsum("...ja,...kb,...lc,...jkl->...abc", g, g, g, part.inductance_slope)
            if part.inductance_slope.any()  # of iron that does not saturate it is 0
            else np.zeros((*u.shape[:-1], *[w.shape[-1]] * 3)),
        )


def with_eddies(
    at: EddyForms, rising: EddyForms, w: FloatArray, static: MagneticState, flux_linkage: FloatArray
) -> MagneticState:
    """Force (...), motional constants and inductances of all currents w from the static ones at u.

    Parameters
    ----------
    at, rising : EddyForms
        G, lambda and Q, and their derivatives in d.
    static : MagneticState
        Of the shapes (...), (..., n) and (..., n, n).
    flux_linkage : array, shape (..., n)
        The static one.
    """
    u_1, further = _times(rising.coupling, w), _times(rising.inductance, w)
    pull = (flux_linkage * u_1).sum(axis=-1) + ((rising.flux_linkage + 0.5 * further) * w).sum(axis=-1)
    risen = _times(static.inductance, u_1) - static.motional_constant
    motional = _transposed(rising.coupling, flux_linkage) + _transposed(at.coupling, risen)
    motional = motional + rising.flux_linkage + further
    inductance = np.swapaxes(at.coupling, -1, -2) @ (static.inductance @ at.coupling) + at.inductance
    return MagneticState(np.asarray(static.force - pull), -motional, inductance)


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    return np.asarray((matrix @ vector[..., None])[..., 0])


def _transposed(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    return np.asarray((vector[..., None, :] @ matrix)[..., 0, :])
