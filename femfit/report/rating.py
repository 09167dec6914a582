"""What coil and iron allow: currents at the supply, continuous rating, force over the stroke, knee of the iron.

Forces come from a sweep table as arrays over currents and distances, whose reciprocity is checked.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import shapely
from scipy.interpolate import CubicSpline, RegularGridInterpolator

from femfit.audit.carried import WARM_C
from femfit.core.numerics import FloatArray, IntArray, evenly_spread
from femfit.device.bh import BHCurve
from femfit.device.parts import REFERENCE_TEMPERATURE, Actuator, LinearMaterial, Material, copper_growth, is_iron
from femfit.fit.rows import FitRows
from femfit.heat.result import Temperatures
from femfit.model.actuator_model import ActuatorModel
from femfit.report.field_cells import FieldSample

FEWEST_DISTANCES = 5


@dataclass(frozen=True, eq=False)
class SweepGrid:
    """A full grid of m currents and n distances, arrays of shape (m, n)."""

    currents: FloatArray
    distances: FloatArray
    force: FloatArray
    force_error: FloatArray
    force_scale: FloatArray  # What an error is a part of: the force, but for its passages through zero
    flux_linkage: FloatArray | None

    @property
    def is_plane(self) -> bool:
        """Whether a map can show it: a pair of magnets has one current, none."""
        return len(self.currents) > 1 and len(self.distances) > 1


def sweep_grid(rows: FitRows) -> SweepGrid | None:
    """Arrange rows on their grid."""
    currents, distances = rows.currents, rows.distances
    shape = (len(currents), len(distances))
    if len(rows.force) != shape[0] * shape[1]:
        return None
    order = np.lexsort((rows.distance, rows.current))
    flux = None if rows.flux_linkage is None else rows.flux_linkage[order].reshape(shape)
    columns = (rows.force, rows.force_error, rows.force_scale)
    force, error, scale = (values[order].reshape(shape) for values in columns)
    return SweepGrid(currents, distances, force, error, scale, flux)


def reciprocity(grid: SweepGrid) -> float | None:
    """Largest difference of dF/di and -d(flux linkage)/dd over the largest dF/di; None where the table cannot tell.

    Over a pair of adjacent currents the mean of dF/di is the difference quotient; the mean flux linkage is taken by the
    trapezoidal rule, which is exact in a linear actuator, and differentiated along the distance by a cubic spline,
    whose ends, with one neighbour only, are left out.
    """
    if grid.flux_linkage is None or len(grid.currents) < 2 or len(grid.distances) < FEWEST_DISTANCES:
        return None
    mean_flux = 0.5 * (grid.flux_linkage[1:] + grid.flux_linkage[:-1])
    from_force = (np.diff(grid.force, axis=0) / np.diff(grid.currents)[:, None])[:, 1:-1]
    from_flux = -CubicSpline(grid.distances, mean_flux, axis=1)(grid.distances[1:-1], 1)
    return float(np.max(np.abs(from_flux - from_force)) / np.max(np.abs(from_force)))


KNEE_STEP, KNEE_FIELD = 1.1, 1.5
"""Knee of a B-H curve (conventional): 10 % more flux density take 50 % more field, as IEC 61869-2 defines a knee."""

USUAL_KNEES = "soft steel about 1.4 T, power ferrite about 0.25 T"
"""For iron that is drawn without a curve: knees of the library's own curves by the rule above."""

SMALL = 1e-3
"""Forces below this part of the largest one are none: what is left of the solver's errors."""

POINTS = 161
FEWEST = 5
"""Points below half of the current; a parabola has three unknowns."""

LEVELS = 9
"""Most distances in the table over the stroke."""


@dataclass(frozen=True)
class Feed:
    """A current that the coil may carry, and what follows from it."""

    name: str  # ``cold`` or ``warm`` at the supply's voltage, ``reversed`` at its other end, ``rated`` or ``idle``
    current_A: float
    drawn_A: float  # The current within the model's validity domain that forces are taken at
    temperature_C: float
    power_W: float
    density_A_mm2: float | None  # In the wire; None where its diameter is not known
    # At the shortest and the longest distance that the body can have
    force_near_N: float
    force_far_N: float

    @property
    def limited(self) -> bool:
        """Whether the model ends below this current."""
        return abs(self.current_A - self.drawn_A) > 1e-6 * abs(self.current_A)


@dataclass(frozen=True, eq=False)
class Rating:
    """Ratings of a coil and the forces over the distances that the body can have, by the name of the feed."""

    voltage_V: float
    cold_ohm: float
    feeds: tuple[Feed, ...]
    distance_m: FloatArray
    forces_N: dict[str, FloatArray]
    # At the rated current and at the smallest current in size
    inductance_H: FloatArray
    idle_inductance_H: FloatArray
    series_H: float  # In series with the coil, outside of the field
    motor_constant: FloatArray  # dF/di over the root of the cold resistance at the rated current, N/sqrt(W)
    cold_C: float = REFERENCE_TEMPERATURE

    def feed(self, name: str) -> Feed | None:
        """The feed of a name; None where the actuator has none."""
        return next((feed for feed in self.feeds if feed.name == name), None)

    @property
    def reference(self) -> Feed:
        """The feed of inductance and motor constant: the rated one, or the warm one where there is no drawing."""
        feed = self.feed("rated") or self.feed("warm")
        assert feed is not None  # noqa: S101 - rate() makes a warm feed always
        return feed

    def time_constant_s(self, inductance_H: FloatArray) -> FloatArray:
        """(L + L_s) / R of the cold circuit."""
        return np.asarray((inductance_H + self.series_H) / self.cold_ohm)

    @property
    def levels(self) -> IntArray:
        """Places of the table's distances in the arrays."""
        return evenly_spread(len(self.distance_m), LEVELS)


def rate(
    model: ActuatorModel, actuator: Actuator | None, grid: SweepGrid | None = None, heat: Temperatures | None = None
) -> Rating | None:
    """Rate a coil, by what its warmth allows where that is known; None where the model has no circuit, or several.

    Forces are the model's, and with a grid also what the model misses the sweep by, so that they agree with its table.
    """
    circuit, box = model.circuit, model.validity
    if circuit is None:
        return None
    cold = circuit.resistance_ohm
    # As warm as the supply makes it, where that may last
    warm_C = float(heat.windings_C[0]) if heat is not None and heat.lasts else WARM_C
    warm = cold * float(copper_growth(warm_C))
    distance = np.linspace(*model.travel_m, POINTS)
    missed = _missed(model, grid)

    def drawn(current: float) -> float:
        return float(np.clip(current, box.current_min_A, box.current_max_A))

    def force(current: float) -> FloatArray:
        currents = np.full_like(distance, drawn(current))
        return np.asarray(model.force(distance, currents) + missed(np.column_stack([currents, distance])))

    ends = (circuit.voltage_max_V, circuit.voltage_min_V)
    # Where a supply is the same in both directions, the direction that attracts more
    voltage = max(ends, key=lambda end: (abs(end), float(force(end / warm)[0])))
    opposite = min(ends) if voltage == max(ends) else max(ends)
    wanted = [("cold", voltage / cold, REFERENCE_TEMPERATURE), ("warm", voltage / warm, warm_C)]
    magnet = model.has_magnet
    if magnet and voltage * opposite < 0.0 and box.current_min_A < 0.0 < box.current_max_A:
        wanted.append(("reversed", opposite / cold, REFERENCE_TEMPERATURE))
    at_limit = None if heat is None else heat.at_limit
    if at_limit is not None:
        current = float(np.copysign(at_limit.currents_A[0], voltage))
        wanted.append(("rated", current, float(at_limit.windings_C[0])))
    largest = max(float(np.abs(force(current)).max()) for _, current, _ in wanted)
    if magnet and float(np.abs(force(0.0)).max()) > SMALL * largest:
        wanted.append(("idle", 0.0, REFERENCE_TEMPERATURE))
    section = _wire_section_mm2(actuator)
    feeds, forces = [], {}
    for name, current, temperature in wanted:
        forces[name] = force(current)
        ohm = cold * float(copper_growth(temperature))
        density = None if section is None else abs(current) / section
        near, far = float(forces[name][0]), float(forces[name][-1])
        feeds.append(Feed(name, current, drawn(current), temperature, ohm * current**2, density, near, far))
    reference = next(feed.drawn_A for feed in reversed(feeds) if feed.name in {"rated", "warm"})
    motional = model.magnetics.motional_constant(distance, np.full((len(distance), 1), reference))[:, 0]
    return Rating(
        voltage_V=voltage,
        cold_ohm=cold,
        feeds=tuple(feeds),
        distance_m=distance,
        forces_N=forces,
        inductance_H=model.inductance(distance, reference),
        idle_inductance_H=model.inductance(distance, drawn(0.0)),
        series_H=circuit.inductance_H,
        motor_constant=motional / np.sqrt(cold),
    )


def _missed(model: ActuatorModel, grid: SweepGrid | None) -> Callable[[FloatArray], FloatArray]:
    """Sweep minus model at points (current, distance), linear between the sweep's own; zero without a grid."""
    if grid is None or min(grid.force.shape) < 2:
        return lambda points: np.zeros(len(points))
    i, d = np.meshgrid(grid.currents, grid.distances, indexing="ij")
    residual = grid.force - model.force(d, i, extrapolate=True)
    return RegularGridInterpolator((grid.currents, grid.distances), residual, bounds_error=False, fill_value=None)


@dataclass(frozen=True)
class Growth:
    """What the second half of the sweep's largest current adds to the force at the body's shortest distance."""

    distance_m: float
    half_A: float
    full_A: float
    gained_N: float
    expected_N: float  # Without saturation, where the force is a + b i + c i^2: by the force at smaller currents

    @property
    def limited(self) -> bool:
        """Whether saturation takes a tenth of it or more (conventional)."""
        return self.gained_N < 0.9 * self.expected_N


def growth(model: ActuatorModel, current: float | tuple[float, ...]) -> Growth | None:
    """How the force grows to a current, by the model; None where it knows too few smaller currents, or of several."""
    if not isinstance(current, float):
        return None
    low = model.travel_m[0]
    i = np.linspace(0.0, current, 41)
    i = i[(i >= model.validity.current_min_A) & (i <= model.validity.current_max_A)]
    force = np.asarray(model.force(low, i))
    half = np.abs(i) <= 0.5 * abs(current) * (1.0 + 1e-9)
    if np.count_nonzero(half) < FEWEST:
        return None
    powers = (0, 1, 2) if model.has_magnet else (2,)
    columns = np.column_stack([(i / current) ** power for power in powers])
    fitted = columns @ np.linalg.lstsq(columns[half], force[half], rcond=None)[0]
    middle = int(np.argmin(np.abs(i - 0.5 * current)))
    sign = np.copysign(1.0, fitted[-1] - fitted[middle])
    gained, expected = force[-1] - force[middle], fitted[-1] - fitted[middle]
    return Growth(low, float(i[middle]), float(i[-1]), float(sign * gained), float(sign * expected))


def _wire_section_mm2(actuator: Actuator | None) -> float | None:
    if actuator is None or len(actuator.coils) != 1 or actuator.coil.wire_diameter_m is None:
        return None
    return float(0.25e6 * np.pi * actuator.coil.wire_diameter_m**2)


def copper_share(actuator: Actuator) -> float | None:
    """Copper's part of the winding's section; None where the wire's diameter is not known."""
    section = _wire_section_mm2(actuator)
    if section is None:
        return None
    return float(1e-6 * section * actuator.coil.turns / shapely.Polygon(actuator.coil.vertices_m).area)


def knee_T(material: Material) -> float | None:  # noqa: N802 - the unit
    """Flux density from which 10 % more takes 50 % more field; None for a material without a B-H curve."""
    if isinstance(material, LinearMaterial):
        return None
    curve = BHCurve(material.flux_density_T, material.field_A_per_m)
    b = np.linspace(0.05, material.flux_density_T[-1], 2000)
    field = curve.field(b)
    beyond = (b >= b[np.argmax(b / field)]) & (curve.field(KNEE_STEP * b) >= KNEE_FIELD * field)
    return float(b[np.argmax(beyond)]) if beyond.any() else float(b[-1])


@dataclass(frozen=True)
class IronLoad:
    """Flux density in one iron part beside the knee of its material; None for a material without a B-H curve."""

    part: str
    material: str
    flux_density_T: float
    knee_T: float | None

    @property
    def margin(self) -> float | None:
        """How far the knee is above the flux density, as a part of the latter; negative beyond the knee."""
        if self.knee_T is None:
            return None
        return self.knee_T / self.flux_density_T - 1.0 if self.flux_density_T else np.inf


def iron_loads(actuator: Actuator, sample: FieldSample) -> tuple[IronLoad, ...]:
    """Each iron part's largest flux density at a point: the part nearest to its knee first, then the most loaded."""
    loads = [
        IronLoad(region.name, region.material.name, sample.part_flux_density_T[region.name], knee_T(region.material))
        for region in actuator.regions
        if is_iron(region.material) and region.name in sample.part_flux_density_T
    ]
    return tuple(
        sorted(
            loads,
            key=lambda load: (load.margin is None, round(load.margin or 0.0, 6), -round(load.flux_density_T, 6)),
        )
    )
