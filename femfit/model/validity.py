"""The distances and currents that a model was fitted to, outside of which it is not evaluated.

How far a model is from the table that it was fitted to.

What an actuator's drawing is made of, as far as effects and reports depend on it.

What a record told of the noise that moves a device.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.numerics import BoolArray, FloatArray


@dataclass(frozen=True)
class ValidityBox:
    """Where the model was fitted."""

    distance_min_m: float
    distance_max_m: float
    current_min_A: float
    current_max_A: float
    further_A: tuple[tuple[float, float], ...] = ()  # Of each further circuit; currents then have the shape (..., n)
    mirrored: bool = False  # Whether all currents may be reversed together

    def of_each(self, current: FloatArray) -> list[tuple[FloatArray, float, float]]:
        """Currents of each circuit and their limits."""
        limits = [(self.current_min_A, self.current_max_A), *self.further_A]
        if not self.further_A:
            return [(current, *limits[0])]
        if np.ndim(current) == 0 or np.shape(current)[-1] != len(limits):
            raise DomainError(
                f"Currents must have the shape (..., {len(limits)}), one for each circuit in the model's order; "
                f"instead received the shape {np.shape(current)}."
            )
        return [(np.asarray(current)[..., k], *pair) for k, pair in enumerate(limits)]

    @property
    def current_limits_A(self) -> FloatArray:  # noqa: N802  the unit
        """Lowest and highest current of each circuit, shape (n, 2); one row of zeros where there is none."""
        return np.array([(self.current_min_A, self.current_max_A), *self.further_A])

    def grid(self, distances: int, currents: int) -> tuple[FloatArray, FloatArray]:
        """Points over the whole domain, as many along each axis as given.

        Returns
        -------
        distance : array, shape (points,)
        current : array, shape (points,), or (points, n) of several circuits
        """
        axes = [np.linspace(low, high, currents) for low, high in self.current_limits_A]
        points = np.meshgrid(np.linspace(self.distance_min_m, self.distance_max_m, distances), *axes)
        d, *i = (one.ravel() for one in points)
        return d, np.stack(i, axis=-1) if self.further_A else i[0]

    def contains(self, distance: FloatArray, current: FloatArray) -> BoolArray:
        """Whether each point lies in the domain (to 1e-9 of its width); NaN does not."""
        slack_d = 1e-9 * (self.distance_max_m - self.distance_min_m)
        inside = (distance >= self.distance_min_m - slack_d) & (distance <= self.distance_max_m + slack_d)
        reached = self._reached(current)
        if self.mirrored:
            reached = reached | self._reached(-np.asarray(current))
        return np.asarray(inside & reached)

    def _reached(self, current: FloatArray) -> BoolArray:
        """Whether all currents were swept."""
        inside = np.asarray(True)
        for one, low, high in self.of_each(current):
            slack = 1e-9 * (high - low)
            inside = inside & (one >= low - slack) & (one <= high + slack)
        return inside

    def require(self, distance: FloatArray, current: FloatArray) -> None:
        """Refuse points outside of the domain."""
        inside = self.contains(distance, current)
        if not np.all(inside):
            where = np.flatnonzero(~np.atleast_1d(inside).ravel())[0]
            each = self.of_each(current)
            d, *i = (np.broadcast_to(one, inside.shape).ravel()[where] for one in (distance, *(e[0] for e in each)))
            ranges = ", ".join(f"{low:g}..{high:g} A" for _, low, high in each)
            ranges += " (or all of them reversed)" if self.mirrored else ""
            raise DomainError(
                f"Distance and current must lie in {1e3 * self.distance_min_m:g}..{1e3 * self.distance_max_m:g} mm and "
                f"{ranges}, where the model was fitted; instead received "
                f"{1e3 * d:g} mm and {', '.join(f'{one:g} A' for one in i)}. Sweep and fit a wider range."
            )


@dataclass(frozen=True)
class Misfit:
    """How far the model, as it is written, is from the table that it was fitted to.

    Parameters
    ----------
    force_rms_N, force_max_N : float
        Root mean square and maximum of model minus table.
    force_rms_relative : float
        Root mean square of (model - table) / table over the rows.
    force_rms_of_weight : float or None
        ``force_rms_N`` over the moving part's weight, where it can hang within the sweep.
    flux_linkage_rms_Wb, inductance_rms_H, hall_rms_T : float or None
        The same for what else the table has. The inductance is the flux linkage's difference over that of the current,
        from each current to the next.
    against : str
        What it was compared with, for example ``sweep``.
    force_share, flux_linkage_share, inductance_share : float or None
        Each rms over the rms of the table's own values; None in files of earlier versions.
    """

    force_rms_N: float
    force_max_N: float
    force_rms_relative: float
    force_rms_of_weight: float | None
    flux_linkage_rms_Wb: float | None
    hall_rms_T: float | None
    rows: int
    against: str
    inductance_rms_H: float | None = None
    force_share: float | None = None
    flux_linkage_share: float | None = None
    inductance_share: float | None = None


@dataclass(frozen=True)
class ActuatorKind:
    """Which parts of the drawing are magnets, iron and winding."""

    fixed_magnet: bool
    moving_magnet: bool
    fixed_iron: bool
    moving_iron: bool
    coil: bool
    saturates: bool  # Whether a part's material has a B-H curve

    @property
    def has_magnet(self) -> bool:
        """Whether any part has a remanence."""
        return self.fixed_magnet or self.moving_magnet


@dataclass(frozen=True)
class ProcessNoise:
    """What a record told of the noise that moves body and current; None for what it could not tell."""

    acceleration_density: float | None = None  # White acceleration, m^2/s^3
    voltage_V: float | None = None  # White from sample to sample
