"""A levitated body as it really moves: bristles, diffusing eddy currents, a driver and a sensor with their own faults.

m d'' = m g - F(d, i_m) - friction, U_applied = R i + d(flux linkage)/dt, with the field that of the magnetising current
i_m, of which a part follows the winding's current through eddy paths:
i_m = (1 - a_1 - a_2) i + a_1 x_1 + a_2 x_2, x_k' = (i - x_k) / tau_k.
Friction is the model of LuGre, z' = v - s_0 |v| z / g(v), F_f = s_0 z + s_1 z' + c(d) v.

References
----------
C. Canudas de Wit et al., IEEE Trans. Automatic Control 40 (1995) 419: LuGre friction;
R. L. Stoll, The Analysis of Eddy Currents (Clarendon, 1974), chapter 2.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.constants import GRAVITY
from support.trial_study.truth.families import Truth
from support.trial_study.truth.thermal import COPPER_PER_K

_SUBSTEPS = 5
_MOTION, _CURRENT, _EDDY, _BRISTLE, _HEAT, _SEEN = slice(0, 2), 2, slice(3, 5), 5, 6, 7


@dataclass(frozen=True)
class Body:
    """What is different about a body, its driver and its sensor.

    Parameters
    ----------
    viscous_N_s_m, braking : float
        Drag, and by what factor it grows at the nearest distance (eddy currents in the core's face).
    coulomb_N, breakaway, stribeck_m_s, bristle_N_m : float
        Of LuGre's friction: level, static over kinetic, velocity of the transition, stiffness of the bristles.
    leakage : float
        Part of the inductance that no eddy path encloses.
    leads : float
        Voltage that the motion induces beside the winding's own, over it.
    delay_s : float
        Time constant of the filter before the Hall reading.
    driver_gain, dead_zone_V : float
        Applied voltage = (1 + gain) U beyond the dead zone.
    warming_K : float
        Of the winding in steady state at 1 A, with a time constant of 20 s.
    """

    mass_kg: float
    viscous_N_s_m: float = 0.0
    braking: float = 0.0
    coulomb_N: float = 0.0
    breakaway: float = 1.3
    stribeck_m_s: float = 5e-3
    bristle_N_m: float = 400.0
    eddy_shares: tuple[float, float] = (0.0, 0.0)
    eddy_times_s: tuple[float, float] = (3e-3, 0.4e-3)
    leakage: float = 0.1
    leads: float = 0.0
    delay_s: float = 0.0
    driver_gain: float = 0.0
    dead_zone_V: float = 0.0
    warming_K: float = 0.0
    pull_N: float = 0.0
    hall_offset_V: float = 0.0


@dataclass(frozen=True, eq=False)
class MovingTruth:
    """A body in the solved fields of a linear drawing."""

    truth: Truth
    body: Body

    def start(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """The state at rest, shape (runs, 8): d, v, i, two eddy states, bristle, winding's rise, delayed Hall field."""
        state = np.zeros((len(distance), 8))
        state[:, 0], state[:, _CURRENT] = distance, current
        state[:, _EDDY] = current[:, None]
        state = self.warmed(state)
        state[:, _SEEN] = self._hall(state)
        return state

    def warmed(self, state: FloatArray) -> FloatArray:
        """A state whose winding has carried its current for long, shape (runs, 8)."""
        result = state.copy()
        result[:, _HEAT] = self.body.warming_K * state[:, _CURRENT] ** 2
        return result

    def hall_output(self, state: FloatArray) -> FloatArray:
        """The Hall element's output in V, shape (runs,); with a filter before it what that has let through."""
        element = self.truth.actuator.hall
        if element is None:
            return np.zeros(len(state))
        field = state[:, _SEEN] if self.body.delay_s > 0.0 else self._hall(state)
        return np.asarray(element.quiescent_V + self.body.hall_offset_V + element.sensitivity_V_per_T * field)

    def step(self, state: FloatArray, voltage: FloatArray, time_s: float) -> FloatArray:
        """Advance by a sample period under a held voltage: Runge-Kutta steps, short against the fastest path.

        Parameters
        ----------
        state : array, shape (runs, 8)
            As from :meth:`start`.
        voltage : array, shape (runs,)
            Commanded, in V.

        Returns
        -------
        array, shape (runs, 8)
            The next state.
        """
        h = time_s / _SUBSTEPS
        for _ in range(_SUBSTEPS):
            a = self._rate(state, voltage)
            b = self._rate(state + 0.5 * h * a, voltage)
            c = self._rate(state + 0.5 * h * b, voltage)
            e = self._rate(state + h * c, voltage)
            state = state + h / 6.0 * (a + 2.0 * b + 2.0 * c + e)
        return state

    def _magnetising(self, state: FloatArray) -> FloatArray:
        one, two = self.body.eddy_shares
        return (1.0 - one - two) * state[:, _CURRENT] + one * state[:, 3] + two * state[:, 4]

    def _coefficients(self, distance: FloatArray) -> FloatArray:
        """Powers of the current of force, flux linkage and field, shape (3, 3, runs)."""
        near, far = self.truth.base.distances
        low, high = np.log(near), np.log(far)
        x = (2.0 * np.log(np.clip(distance, near, far)) - low - high) / (high - low)  # beyond, the body is lost
        table = self.truth.base.coefficients
        waves = np.cos(np.arccos(x.clip(-1.0, 1.0))[:, None] * np.arange(table.shape[1]))  # Chebyshev's polynomials
        return np.moveaxis(np.tensordot(waves, table, (1, 1)), 0, 2)

    def _hall(self, state: FloatArray) -> FloatArray:
        field = self._coefficients(state[:, 0])[2]
        return np.asarray(field[0] + field[1] * self._magnetising(state))

    def _rate(self, state: FloatArray, voltage: FloatArray) -> FloatArray:
        body = self.body
        distance, velocity, current = state[:, 0], state[:, 1], state[:, _CURRENT]
        magnetising = self._magnetising(state)
        force_of, flux_of, field_of = self._coefficients(distance)
        force = force_of[0] + force_of[1] * magnetising + force_of[2] * magnetising**2
        motional = force_of[1] + 2.0 * force_of[2] * magnetising  # k_m = dF/di
        inductance = flux_of[1]
        rate = np.zeros_like(state)
        rate[:, 0] = velocity
        friction, rate[:, _BRISTLE] = self._friction(distance, velocity, state[:, _BRISTLE])
        rate[:, 1] = GRAVITY + (body.pull_N - force - friction) / body.mass_kg
        paths = (current[:, None] - state[:, _EDDY]) / np.array(body.eddy_times_s)
        rate[:, _EDDY] = paths
        shares = np.array(body.eddy_shares)
        behind = paths @ shares  # di_m/dt without the winding's own part
        resistance = self.truth.actuator.coil.resistance_ohm * (1.0 + COPPER_PER_K * state[:, _HEAT])
        induced = (1.0 + body.leads) * motional * velocity - (1.0 - body.leakage) * inductance * behind
        own = inductance * ((1.0 - body.leakage) * (1.0 - shares.sum()) + body.leakage)
        rate[:, _CURRENT] = (self._applied(voltage) - resistance * current + induced) / own
        rate[:, _HEAT] = (body.warming_K * current**2 - state[:, _HEAT]) / 20.0
        if body.delay_s > 0.0:
            rate[:, _SEEN] = (field_of[0] + field_of[1] * magnetising - state[:, _SEEN]) / body.delay_s
        return rate

    def _friction(
        self, distance: FloatArray, velocity: FloatArray, bristle: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Force against the motion, and the bristles' rate."""
        body = self.body
        near = (self.truth.base.distances[0] / distance) ** 4
        viscous = body.viscous_N_s_m * (1.0 + body.braking * near) * velocity
        if body.coulomb_N == 0.0:
            return viscous, np.zeros_like(velocity)
        level = body.coulomb_N * (1.0 + (body.breakaway - 1.0) * np.exp(-((velocity / body.stribeck_m_s) ** 2)))
        rate = velocity - body.bristle_N_m * np.abs(velocity) * bristle / level
        damping = 2.0 * 0.3 * np.sqrt(body.bristle_N_m * body.mass_kg)  # bristles damped to 0.3 of critical
        return viscous + body.bristle_N_m * bristle + damping * rate, rate

    def _applied(self, voltage: FloatArray) -> FloatArray:
        body = self.body
        beyond = np.sign(voltage) * np.maximum(np.abs(voltage) - body.dead_zone_V, 0.0)
        return (1.0 + body.driver_gain) * beyond
