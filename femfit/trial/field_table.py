"""Field solutions of drawings as smooth functions of distance and current.

Solved at Chebyshev nodes of log distance (of the distance itself where some are zero or below) and interpolated by the
polynomial through them: the fields are analytic in the distance, so the error of the interpolation falls geometrically
(L. N. Trefethen, Approximation Theory and Approximation Practice, SIAM 2013, chapter 8). In the current a linear
drawing is a parabola. Where iron saturates the knee is sharp at small gaps: a polynomial through 13 currents misses the
force of a solenoid by 3 % of its largest. Such a drawing is measured at the currents that were solved, where nothing is
interpolated; a cubic spline serves for the small shifts that errors of the bench make.

A device on a virtual bench: its solved fields, what can be wrong with it, and what its sensors would then read.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from scipy.interpolate import CubicSpline

from femfit.core.errors import DomainError, FieldSolverError
from femfit.core.numerics import FloatArray, IntArray
from femfit.device.parts import Actuator, SweepAxes
from femfit.device.rewrite import Variant, VariantSweep
from femfit.field.sweep import Progress, run_sweep
from femfit.field.tolerance import SolverSettings

LINEAR_DISTANCES, SATURATING_DISTANCES, CURRENTS = 16, 12, 8

_FREE_CURRENTS = 15
"""Of the saturating form of a linear drawing, whose knee is round: its gap is wide."""

_CURRENT_MARGIN = 0.05
"""Beyond the largest current, for meters that are off."""

_MARGIN = 0.06
"""Beyond either end of distances that are not positive throughout, over their span."""

_EDGE = 1.02
"""How far beyond its nodes a polynomial of this degree still holds: its last term grows at most tenfold there."""


@dataclass(frozen=True, eq=False)
class FieldTable:
    """Fields of a drawing."""

    distances: tuple[float, float]  # Range in m
    currents: tuple[float, ...]  # Those that were solved, in A, ascending; three of a linear drawing
    # Of force, flux linkage and Hall field: Chebyshev polynomials in (log) distance at each current, (3, N_d, N_i)
    coefficients: FloatArray

    def at(self, distance: FloatArray, current: FloatArray) -> FloatArray:
        """Force (N), flux linkage (Wb) and Hall field (T, 0 without an element) at n points in m and A, shape (3, n).

        DomainError outside of what was solved; a parabola through three currents holds at any.
        """
        coordinate = _coordinate(self.distances)
        first, last = map(coordinate, self.distances)
        x = (2.0 * coordinate(distance) - first - last) / (last - first)
        solved = self.currents if len(self.currents) > 3 else ()
        outside = solved and current.size and not solved[0] <= current.min() <= current.max() <= solved[-1]
        if outside or np.abs(x).max(initial=0.0) > _EDGE:
            low, high = 1e3 * np.array(self.distances)
            reach = f" and {solved[0]:.3g} to {solved[-1]:.3g} A" if solved else ""
            raise DomainError(f"A virtual bench must stay where it was solved, {low:.3g} to {high:.3g} mm{reach}.")
        in_distance = chebvander(x, self.coefficients.shape[1] - 1)
        in_current = CubicSpline(self.currents, np.eye(len(self.currents)))(current)
        return np.asarray(np.einsum("na,cab,nb->cn", in_distance, self.coefficients, in_current, optimize=True))


def solve_drawings(
    drawings: Mapping[str, Actuator], directory: Path, *, workers: int, progress: Progress | None = None
) -> dict[str, FieldTable]:
    """Solve forms of one actuator as the variants of one sweep, which is taken up again where it was interrupted.

    The range is a little wider than the sweep of the first drawing, for benches whose dials are off.
    """
    first = next(iter(drawings.values()))
    distances = _range(first.sweep.distances_m)
    planned = {
        name: replace(form, sweep=_nodes(form, distances, not first.saturates)) for name, form in drawings.items()
    }
    variants = tuple(Variant((name,), form.sweep, form) for name, form in planned.items())
    sweep = VariantSweep(next(iter(planned.values())), ("form",), variants)
    rows = run_sweep(sweep, directory, workers=workers, settings=SolverSettings(), progress=progress).rows
    for _, row in rows[rows["status"] != "ok"].iterrows():
        raise FieldSolverError(
            f"The virtual bench must solve {first.name} ({row['form']}) at {1e3 * row['distance_m']:.3g} mm; it "
            f"{row['status']}. Let the sweep begin at a larger distance, or end at a smaller one."
        )
    fields = rows.reindex(columns=["force_N", "flux_linkage_Wb", "hall_T"], fill_value=0.0)
    tables = {}
    for name, form in planned.items():
        currents, count = form.sweep.currents_A, len(form.sweep.distances_m)
        values = fields[rows["form"] == name].to_numpy(dtype=np.float64).T.reshape(3, len(currents), count)
        coefficients = np.linalg.solve(chebvander(_chebyshev(count), count - 1), values.swapaxes(1, 2))
        tables[name] = FieldTable(distances, currents, coefficients)
    return tables


def dialled_currents(actuator: Actuator) -> tuple[float, ...]:
    """Currents at which a saturating drawing is measured: even steps over its sweep."""
    currents = actuator.sweep.currents_A
    both = min(currents) < 0.0
    largest = max(map(abs, currents))
    return tuple(np.linspace(-largest if both else 0.0, largest, CURRENTS + (CURRENTS + 1) % 2 * both).tolist())


def _nodes(actuator: Actuator, distances: tuple[float, float], free: bool) -> SweepAxes:
    """Where a drawing is solved; ``free`` where the bench takes any current, as of a linear drawing's forms."""
    low, high = map(_coordinate(distances), distances)
    x = _chebyshev(SATURATING_DISTANCES if actuator.saturates else LINEAR_DISTANCES)
    nodes = 0.5 * (low + high) + 0.5 * (high - low) * x
    largest = (1.0 + _CURRENT_MARGIN) * max(map(abs, actuator.sweep.currents_A))
    currents = np.linspace(-largest, largest, _FREE_CURRENTS if actuator.saturates else 3)
    if actuator.saturates and not free:
        dialled = dialled_currents(actuator)
        currents = np.array([dialled[0] - _CURRENT_MARGIN * dialled[-1], *dialled, largest])
    return SweepAxes(tuple(currents.tolist()), tuple((np.exp(nodes) if distances[0] > 0.0 else nodes).tolist()))


def _range(swept: tuple[float, ...]) -> tuple[float, float]:
    """A little more than was swept; not where the parts touch."""
    low, high = swept[0], swept[-1]
    if low > 0.0:
        return 0.8 * low, 1.06 * high
    margin = _MARGIN * (high - low)
    return low - margin if low < 0.0 else low, high + margin


def _coordinate(distances: tuple[float, float]) -> Callable[[FloatArray | float], FloatArray | float]:
    return np.log if distances[0] > 0.0 else np.asarray


def _chebyshev(count: int) -> FloatArray:
    return np.asarray(np.cos(np.pi * (np.arange(count) + 0.5) / count)[::-1])


@dataclass(frozen=True, eq=False)
class Conditions:
    """Settings of n readings, in the order of measuring: m, A, s since the start of the run, degC."""

    distance: FloatArray
    current: FloatArray
    time_s: FloatArray
    coil_C: FloatArray
    magnet_C: FloatArray
    run: IntArray  # From 0
    campaign_s: FloatArray  # Since the start of the campaign


@dataclass(frozen=True, eq=False)
class Device:
    """A drawing's fields, and those of its changed forms."""

    actuator: Actuator
    drawn: FieldTable
    families: Mapping[str, Mapping[float, FieldTable]]  # By a number p, never 0, that changes the drawing

    def change(self, family: str, p: FloatArray | float, settings: Conditions) -> FloatArray:
        """What a change p adds to the drawn fields, by the polynomial through the solutions; also one p a point."""
        base, tables = self.drawn.at(settings.distance, settings.current), self.families[family]
        total = np.zeros_like(base)
        for value, table in tables.items():
            weight = np.asarray(p / value)
            for node in tables:
                weight = weight if node == value else weight * (p - node) / (value - node)
            total += (table.at(settings.distance, settings.current) - base) * weight
        return total

    def with_turns(self, change: float, settings: Conditions) -> FloatArray:
        """What 1 + change times the turns add to the drawn fields: they are those of as much more current."""
        more = self.drawn.at(settings.distance, (1.0 + change) * settings.current)
        more[1] *= 1.0 + change
        return more - self.drawn.at(settings.distance, settings.current)

    @property
    def largest_current(self) -> float:
        """Of the sweep, in A."""
        return max(map(abs, self.actuator.sweep.currents_A))

    @property
    def largest_force(self) -> float:
        """At the smallest distance and the last current of the sweep, in N."""
        near, most = self.actuator.sweep.distances_m[0], self.actuator.sweep.currents_A[-1]
        return float(abs(self.drawn.at(np.array([near]), np.array([most]))[0, 0]))

    @property
    def largest_shift(self) -> float:
        """Largest error of a stage's zero that is believable, in m."""
        low, high = self.drawn.distances
        if low <= 0.0:  # no distance is near: the margin of the solved fields
            return 0.02 * (high - low)
        return min(1e-3, 0.15 * low + 0.01 * (high - low))


Readings = Mapping[str, FloatArray]


@dataclass(frozen=True)
class HiddenError:
    """One thing that is wrong, up to its size: what it changes of settings, of fields and of readings."""

    limit: Callable[[Device], float]  # Takes the device; the largest size that is still believable
    channels: tuple[str, ...]  # Those that show it, of which a campaign records at least one
    needs: str = ""  # What the drawing must have; empty for nothing
    setting: Callable[[Device, float, Conditions], Conditions] = lambda *arguments: arguments[-1]
    fields: Callable[[Device, float, Conditions], FloatArray | float] = lambda *_: 0.0
    reading: Callable[[Device, float, Conditions, Readings], Readings] = lambda *_: {}
    names: tuple[str, ...] | None = None  # Of the diagnosis that are right; None: what it is called here


def true_readings(
    device: Device, settings: Conditions, hidden: Mapping[str, float], errors: Mapping[str, HiddenError]
) -> dict[str, FloatArray]:
    """What the sensors would read without noise; hidden errors by name, with their sizes."""
    wrong = [(errors[name], size) for name, size in hidden.items()]
    for error, size in wrong:
        settings = error.setting(device, size, settings)
    fields, hall = device.drawn.at(settings.distance, settings.current), device.actuator.hall
    for error, size in wrong:
        fields = fields + error.fields(device, size, settings)
    values = {
        "force_N": fields[0],
        "flux_linkage_Wb": fields[1],
        "voltage_V": device.actuator.coil.resistance_ohm * settings.current,
    }
    if hall is not None:
        values["hall_V"] = hall.quiescent_V + hall.sensitivity_V_per_T * fields[2]
    for error, size in wrong:
        values |= error.reading(device, size, settings, values)
    return values
