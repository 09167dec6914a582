"""The distances and currents that a model was fitted to, outside of which it is not evaluated."""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.core.errors import DomainError


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
