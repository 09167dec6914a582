"""The co-energy of circuits and eddy currents together, from the static one by the chain rule.

With w = (i, e), G = (1, C), u = G w, phi = dW_s/du, L = d^2 W_s/du^2 and a dash for the derivative in d:

    dW'/dw = G^T phi + (0, lambda + Q e),    d^2 W'/dw^2 = G^T L G + (0, Q),
    dW'/dd = dW_s/dd + phi . u' + lambda' . e + e^T Q' e / 2,    u' = C' e,

and so on for the slopes that Jacobians need.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.model.eddy_currents import EddyCurrents, EddyForms
from femfit.model.magnetics import Magnetics, MagneticSlopes, MagneticState
from femfit.model.several_magnetics import SeveralMagnetics


@dataclass(frozen=True, eq=False)
class EddyMagnetics(SeveralMagnetics):
    """W'(d, i, e) of the module's head; currents are (i_1..i_n, e_1..e_r)."""

    static: Magnetics
    eddy: EddyCurrents

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]  # derived here
        """Of the circuits, then of the patterns."""
        return (*self.eddy.circuits, *self.eddy.names)

    def acting(self, distance: FloatArray, currents: FloatArray) -> FloatArray:
        """The circuits' currents u = i + C e (..., n) that act on the static field like all currents together."""
        i, e = self._apart(currents)
        return acting(i, self.eddy.seen(distance)[0][0], e)

    def coenergy(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """W' in J, up to a constant, of shape (...)."""
        i, e = self._apart(current)
        (at,) = self.eddy.forms(distance)
        return np.asarray(
            self.static.coenergy(distance, self._of_static(acting(i, at.coupling, e)))
            + (at.flux_linkage * e).sum(axis=-1)
            + 0.5 * (e * _times(at.inductance, e)).sum(axis=-1)
        )

    def flux_linkage(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """dW'/dw in Wb, of shape (..., n + r)."""
        i, e = self._apart(current)
        (at,) = self.eddy.forms(distance)
        phi = self._static_flux(distance, acting(i, at.coupling, e))
        return _joined(phi, _transposed(at.coupling, phi) + at.flux_linkage + _times(at.inductance, e))

    def force(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """F = -dW'/dd in N, of shape (...)."""
        return self.state(distance, current).force

    def motional_constant(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """dF/dw in N/A, of shape (..., n + r)."""
        return self.state(distance, current).motional_constant

    def inductance(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """d(flux linkages)/dw in H, of shape (..., n + r, n + r)."""
        return self.state(distance, current).inductance

    def force_gradient(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """dF/dd in N/m, of shape (...)."""
        return self.slopes_of_circuits(distance, current).force_gradient

    def state(self, distance: FloatArray, current: FloatArray) -> MagneticState:
        """Force (...), motional constants (..., n + r) and inductances (..., n + r, n + r) together."""
        i, e = self._apart(current)
        at, rising = self.eddy.forms(distance, 0, 1)
        u = acting(i, at.coupling, e)
        if len(self.eddy.circuits) != 1:
            found = self.static.state_of_circuits(distance, u)
            return with_eddies(at, rising, e, found, self._static_flux(distance, u))
        slope, phi, mixed, curved = self.static.coenergy_derivatives(
            distance, u[..., 0], ((1, 0), (0, 1), (1, 1), (0, 2))
        )
        found = MagneticState(-slope, -mixed[..., None], curved[..., None, None])
        return with_eddies(at, rising, e, found, phi[..., None])

    def slopes_of_circuits(self, distance: FloatArray, currents: FloatArray) -> MagneticSlopes:
        """The slopes of all currents."""
        i, e = self._apart(currents)
        at, rising, bent = self.eddy.forms(distance, 0, 1, 2)
        u = acting(i, at.coupling, e)
        part, phi = self.static.slopes_of_circuits(distance, u), self._static_flux(distance, u)
        u_1, u_2 = _times(rising.coupling, e), _times(bent.coupling, e)
        inductance, along = part.inductance, np.einsum("...jkl,...l->...jk", part.inductance_slope, u_1)
        # The derivatives in d of phi at held w, and of its part beside L u_1
        risen = _times(inductance, u_1) - part.motional_constant
        bending = -part.motional_gradient + _times(2.0 * part.inductance_gradient + along, u_1)
        bending = bending + _times(inductance, u_2)
        second = (
            -part.force_gradient
            + (u_1 * (risen - part.motional_constant)).sum(axis=-1)
            + (phi * u_2).sum(axis=-1)
            + (bent.flux_linkage * e).sum(axis=-1)
            + 0.5 * (e * _times(bent.inductance, e)).sum(axis=-1)
        )
        of_eddies = (
            _transposed(bent.coupling, phi)
            + 2.0 * _transposed(rising.coupling, risen)
            + _transposed(at.coupling, bending)
            + bent.flux_linkage
            + _times(bent.inductance, e)
        )
        g, g_1 = _shift(at.coupling, u.shape), _shift(rising.coupling, u.shape, 0.0)
        half = np.swapaxes(g_1, -1, -2) @ inductance @ g
        gradient = half + np.swapaxes(half, -1, -2) + np.swapaxes(g, -1, -2) @ (part.inductance_gradient + along) @ g
        n = u.shape[-1]
        gradient[..., n:, n:] += rising.inductance
        state = with_eddies(at, rising, e, MagneticState(part.force, part.motional_constant, inductance), phi)
        return MagneticSlopes(
            motional_constant=state.motional_constant,
            inductance=state.inductance,
            force=state.force,
            force_gradient=-second,
            motional_gradient=-_joined(bending, of_eddies),
            inductance_gradient=gradient,
            inductance_slope=np.einsum("...ja,...kb,...lc,...jkl->...abc", g, g, g, part.inductance_slope),
        )

    def _apart(self, currents: FloatArray) -> tuple[FloatArray, FloatArray]:
        currents, n = np.asarray(currents, dtype=np.float64), len(self.eddy.circuits)
        return currents[..., :n], currents[..., n:]

    def _of_static(self, u: FloatArray) -> FloatArray:
        """Currents in the shape that the static co-energy takes."""
        if len(self.eddy.circuits) > 1:
            return u
        return u[..., 0] if self.eddy.circuits else np.zeros(u.shape[:-1])

    def _static_flux(self, distance: FloatArray, u: FloatArray) -> FloatArray:
        if not self.eddy.circuits:
            return u
        flux = self.static.flux_linkage(distance, self._of_static(u))
        return flux if len(self.eddy.circuits) > 1 else flux[..., None]


def acting(i: FloatArray, coupling: FloatArray, e: FloatArray) -> FloatArray:
    """U = i + C e, of shape (..., n)."""
    return np.asarray(i + _times(coupling, e))


def with_eddies(
    at: EddyForms, rising: EddyForms, e: FloatArray, static: MagneticState, flux_linkage: FloatArray
) -> MagneticState:
    """Force (...), motional constants and inductances of all currents from the static ones at u.

    Parameters
    ----------
    at, rising : EddyForms
        C, lambda and Q, and their derivatives in d.
    static : MagneticState
        Of the shapes (...), (..., n) and (..., n, n).
    flux_linkage : array, shape (..., n)
        The static one.
    """
    u_1, n = _times(rising.coupling, e), flux_linkage.shape[-1]
    further = _times(rising.inductance, e)
    pull = (flux_linkage * u_1).sum(axis=-1) + ((rising.flux_linkage + 0.5 * further) * e).sum(axis=-1)
    risen = _times(static.inductance, u_1) - static.motional_constant
    of_eddies = _transposed(rising.coupling, flux_linkage) + _transposed(at.coupling, risen)
    motional = -_joined(risen, of_eddies + rising.flux_linkage + further)
    inductance = np.empty((*motional.shape, motional.shape[-1]))
    mixed = static.inductance @ at.coupling
    inductance[..., :n, :n], inductance[..., :n, n:] = static.inductance, mixed
    inductance[..., n:, :n] = np.swapaxes(mixed, -1, -2)
    inductance[..., n:, n:] = np.swapaxes(at.coupling, -1, -2) @ mixed + at.inductance
    return MagneticState(np.asarray(static.force - pull), motional, inductance)


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    return np.asarray((matrix @ vector[..., None])[..., 0])


def _transposed(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    return np.asarray((vector[..., None, :] @ matrix)[..., 0, :])


def _joined(of_circuits: FloatArray, of_eddies: FloatArray) -> FloatArray:
    shape = np.broadcast_shapes(of_circuits.shape[:-1], of_eddies.shape[:-1])
    parts = (np.broadcast_to(one, (*shape, one.shape[-1])) for one in (of_circuits, of_eddies))
    return np.concatenate(list(parts), axis=-1)


def _shift(coupling: FloatArray, shape: tuple[int, ...], unit: float = 1.0) -> FloatArray:
    """G = (unit 1, C), of shape (..., n, n + r)."""
    n = shape[-1]
    result = np.zeros((*shape, n + coupling.shape[-1]))
    result[..., range(n), range(n)] = unit
    result[..., n:] = coupling
    return result
