"""What is known of a model beside its parts: its domain, its misfit, what it was drawn of, and what a record told.

A model is not evaluated outside of the distances and currents that it was fitted to.
"""

from dataclasses import dataclass, field

import numpy as np

from femfit.core.errors import DomainError
from femfit.core.numerics import BoolArray, FloatArray


@dataclass(frozen=True)
class FiledCurrents:
    """Ranges of currents as a model file has them: of the first circuit, and of the further ones."""

    current_min_A: float
    current_max_A: float
    further_A: tuple[tuple[float, float], ...] = ()

    @classmethod
    def of(cls, limits: FloatArray) -> "FiledCurrents":
        """Ranges (n, 2) as the file has them; of no winding a current of zero."""
        (low, high), *rest = limits.tolist() or [(0.0, 0.0)]
        return cls(low, high, tuple(map(tuple, rest)))

    @property
    def value(self) -> FloatArray:
        """The ranges, shape (n, 2)."""
        return np.array([(self.current_min_A, self.current_max_A), *self.further_A])


@dataclass(frozen=True, eq=False)
class ValidityBox:
    """Where the model was fitted; currents have the shape (..., n), and n is none for a pair of magnets."""

    distance_min_m: float
    distance_max_m: float
    # Lowest and highest current of each circuit, shape (n, 2)
    current_limits_A: FloatArray = field(metadata={"flat": True, "form": FiledCurrents})
    mirrored: bool = False  # Whether all currents may be reversed together

    @classmethod
    def of_currents(
        cls,
        distances_m: tuple[float, float],
        *currents_A: tuple[float, float],
        winding: bool = True,
        mirrored: bool = False,
    ) -> "ValidityBox":
        """The domain of distances and of each circuit's currents; zeros are no circuit's where there is no winding."""
        limits = np.array(currents_A, dtype=np.float64).reshape(-1, 2)
        return cls(*distances_m, limits if winding or limits.any() else limits[:0], mirrored)

    @property
    def current_min_A(self) -> float:  # noqa: N802  the unit
        """Lowest current of the first circuit; zero where there is none."""
        return float(self.column_limits_A[0, 0])

    @property
    def current_max_A(self) -> float:  # noqa: N802  the unit
        """Highest current of the first circuit; zero where there is none."""
        return float(self.column_limits_A[0, 1])

    @property
    def column_limits_A(self) -> FloatArray:  # noqa: N802  the unit
        """The limits of a table's columns of currents: of one of 0 A where there is no winding, shape (n or 1, 2)."""
        return self.current_limits_A if len(self.current_limits_A) else np.zeros((1, 2))

    def with_axis(self, current: FloatArray) -> FloatArray:
        """Currents (..., n) of those without an axis, (...), that one circuit's callers give, or none's."""
        if (count := len(self.current_limits_A)) < 2:
            return np.asarray(current)[..., None][..., :count]
        self._require_axis(current)
        return np.asarray(current)

    def _require_axis(self, currents: FloatArray) -> None:
        if np.shape(currents)[-1:] != (len(self.current_limits_A),):
            raise DomainError(
                f"Currents must have the shape (..., {len(self.current_limits_A)}), one for each circuit in the "
                f"model's order; instead received the shape {np.shape(currents)}."
            )

    def grid(self, distances: int, currents: int, several: int | None = None) -> tuple[FloatArray, FloatArray]:
        """Points over the whole domain.

        Parameters
        ----------
        distances, currents : int
            How many along each axis.
        several : int or None
            How many along the current of each of several circuits, where these are fewer.

        Returns
        -------
        distance : array, shape (points,)
        currents : array, shape (points, n)
        """
        count = currents if several is None or len(self.current_limits_A) < 2 else several
        axes = [np.linspace(low, high, count) for low, high in self.current_limits_A]
        points = np.meshgrid(np.linspace(self.distance_min_m, self.distance_max_m, distances), *axes)
        d, *i = (axis.ravel() for axis in points)
        return d, np.stack(i, axis=-1) if i else np.zeros((len(d), 0))

    def contains(self, distance: FloatArray, currents: FloatArray) -> BoolArray:
        """Whether each point lies in the domain (to 1e-9 of its width); NaN does not."""
        slack_d = 1e-9 * (self.distance_max_m - self.distance_min_m)
        inside = (distance >= self.distance_min_m - slack_d) & (distance <= self.distance_max_m + slack_d)
        low, high = self.current_limits_A.T
        slack = 1e-9 * (high - low)
        reached = [
            np.all((signed >= low - slack) & (signed <= high + slack), axis=-1)
            for signed in ((currents, -np.asarray(currents)) if self.mirrored else (currents,))
        ]
        return np.asarray(inside & np.any(reached, axis=0))

    def require(self, distance: FloatArray, currents: FloatArray) -> None:
        """Refuse points outside of the domain."""
        self._require_axis(currents)
        inside = self.contains(distance, currents)
        if np.all(inside):
            return
        place = np.unravel_index(np.argmin(inside), inside.shape)
        d, *i = (float(np.broadcast_to(x, inside.shape)[place]) for x in (distance, *np.moveaxis(currents, -1, 0)))
        spans = [f"{1e3 * self.distance_min_m:g}..{1e3 * self.distance_max_m:g} mm"]
        spans += [", ".join(f"{low:g}..{high:g} A" for low, high in self.current_limits_A)][: len(i)]
        point = [f"{1e3 * d:g} mm", ", ".join(f"{current:g} A" for current in i)][: 1 + len(i)]
        ranges = " and ".join(spans) + (" (or all of them reversed)" if self.mirrored else "")
        raise DomainError(
            f"Distance and current must lie in {ranges}, where the model was fitted; instead received "
            f"{' and '.join(point)}. Sweep and fit a wider range."
        )


@dataclass(frozen=True)
class BetweenPoints:
    """What a co-energy is expected to miss between the points of its sweep, where most, and what to add there.

    Where the iron saturates it is told by the points left out, to within a factor of two mostly; else it is what the
    points themselves are missed by.
    """

    force_rms_N: float
    force_share: float  # Of the rms of the table's own force, as the inductance's of its
    distance_m: float
    current_A: float
    finer_distance_m: tuple[float, ...]  # Settings that halve the intervals around that place
    finer_current_A: tuple[float, ...]
    # None where the iron does not saturate
    flux_linkage_rms_Wb: float | None = None
    inductance_share: float | None = None


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
    between : BetweenPoints or None
        Of one circuit's co-energy what it misses between those points; None in files of earlier versions.
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
    between: BetweenPoints | None = field(default=None, metadata={"omit": True})


@dataclass(frozen=True)
class ActuatorKind:
    """Which parts of the drawing are magnets, iron and winding, as far as effects and reports depend on it."""

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
