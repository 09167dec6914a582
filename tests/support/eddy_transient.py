"""A winding's field behind a resistance in implicit time steps: what reduced models of eddy currents stand for.

Each stage minimises an energy: that of the static field, what the induced currents cost, and the supply's. A body moves
by velocity Verlet with the field's own force.
"""

import math
from dataclasses import replace
from functools import cache
from tempfile import TemporaryDirectory

import ngsolve as ng
import numpy as np

import femfit as ff
from femfit.device.load import actuator_from_toml
from femfit.field.eddy_sweep import ORDER
from femfit.field.harmonic import ConductorPoints, add_eddy_form, conductors
from femfit.field.layout import layout_of
from femfit.field.moving_mesh import MovingMesh
from femfit.field.newton import Expansion, inner, minimise
from femfit.field.nonlinear_system import NonlinearSystem, SummedInverse
from femfit.field.tolerance import SolverSettings
from femfit.field.weak_form import LayerForce
from support.small_drawing import POT

GAMMA = 1.0 - 1.0 / math.sqrt(2.0)
"""Of Alexander's two implicit stages of the second order, L-stable (SIAM J. Numer. Anal. 14 (1977) 1006)."""


def step_of_windings(inductances, resistances, volts, times):
    """The same of linked windings at rest, the first of which gets the volts: exact, by the modes of L^-1 R."""
    root = 1.0 / np.sqrt(resistances)
    delays, modes = np.linalg.eigh(root[:, None] * inductances * root)  # of di/dt = L^-1 (U - R i), made symmetric
    grown = 1.0 - np.exp(-times[:, None] / delays)
    currents = (grown * modes[0] * volts * root[0]) @ modes.T * root
    return currents[:, 0], currents @ inductances[0]


def mesh_for(actuator, distance, highest_Hz, order=ORDER):
    """A mesh with the moving part at a distance in m, whose elements resolve the skin at a frequency."""
    settings = SolverSettings(order=order, skin_frequency_Hz=highest_Hz)
    return MovingMesh(actuator, (distance,), layout_of(actuator, settings), settings)


TOLERANCE = 1e-6  # of Newton's iteration


class Stage:
    """What :func:`femfit.field.newton.minimise` minimises: E(w) + s (w M w / 2 - held w) + R i^2 / (2 s).

    With i = (volts + s (flux - load w)) / R its minimum solves K(w) w + s (M w - held) = load i and the circuit's
    volts = R i + s (load w - flux).
    """

    def __init__(self, system, points, actuator):
        self.system, self.points = system, points
        self.resistance, self.load = actuator.circuits[0].resistance_ohm, system.circuits[0]
        self._s = ng.Parameter(1.0)
        self._form = system.points.tangent_on(system.space)
        add_eddy_form(self._form, conductors(actuator), self._s)
        self._inverse, self.ready = SummedInverse(system.space), False

    def set(self, s, held, flux, volts):
        """Take the rate s, rows of the induced currents' past, the flux linkage's, and the voltage."""
        self.ready = self.ready and s == self._s.Get()
        self._s.Set(s)
        self.s, self.held, self.flux, self.volts = s, held, flux, volts

    def move(self):
        self.system.move()
        self.ready = False

    def current(self, w):
        return (self.volts + self.s * (self.flux - inner(self.load, w))) / self.resistance

    def lag(self, w):
        """M w - held, as rows of the conductors' points."""
        return self.points.rows(w[None])[0] - self.held

    def evaluate(self, w, _):
        static, i, s = self.system.evaluate(w, np.zeros(1)), self.current(w), self.s
        rows = self.points.rows(w[None])[0]
        cost = s * inner(self.points.weight, rows * (0.5 * rows - self.held))
        induced = s * self.points.loads(self.lag(w)[None])[0]
        square = s * inner(self.points.weight, rows**2) + s / self.resistance * inner(self.load, w) ** 2
        return Expansion(
            static.energy + cost + self.resistance * i * i / (2.0 * s),
            static.gradient + induced - i * self.load,
            static.square + square,
        )

    def renew(self, w):
        self.system.points.set_tangent(self.system.points.flux_density(w))  # assembles a form too many
        self._form.Assemble()
        self._inverse.renew((self.system._air, self._form))
        self._unit, self.ready = self._inverse.solve(self.load), True

    def solve(self, right):
        """Solve with it; the circuit adds a matrix of rank one."""
        plain, share = self._inverse.solve(right), self.s / self.resistance
        along = share * inner(self.load, plain) / (1.0 + share * inner(self.load, self._unit))
        return plain - along * self._unit


class FieldInTime:
    """The field of an actuator with one circuit, at distances of one stretched mesh."""

    def __init__(self, actuator, distances, order, skin_frequency_Hz):
        settings = SolverSettings(order=order, skin_frequency_Hz=skin_frequency_Hz)
        self.actuator = actuator
        self.moving = MovingMesh(actuator, tuple(sorted(distances)), layout_of(actuator, settings), settings)
        self.system = NonlinearSystem(self.moving, actuator, order)
        self.points = ConductorPoints(self.system.space, actuator, self.moving.reference)
        self.stage = Stage(self.system, self.points, actuator)
        self.layer = LayerForce(self.system.space, self.moving.mover_weight)

    def force(self, w, current):
        """On the moving part in N, of the last stage."""
        system, stage = self.system, self.stage
        induced = stage.s * self.points.loads(stage.lag(w)[None], moving=True)[0]
        magnetised = system.points.magnetisation(system.points.flux_density(w)) * system.points.moving
        load = system.points.load(magnetised) + current * system.own_circuits[0] - induced
        return (self.layer.of_sum(w[None]) - self.layer.of_sum(system.solve_free(load[None]))).item()

    def run(self, volts, start, steps, *, until=None):
        """Times, distances, currents, flux linkages and forces from rest at a distance, by steps in s.

        Without ``until`` the body is held; else it moves until that distance.
        """
        stage, motion = self.stage, self.actuator.mechanics
        w, held, flux = np.zeros(self.system.space.ndof), np.zeros(len(self.points.weight)), 0.0
        distance, velocity, time = start, 0.0, 0.0
        acceleration = 0.0 if until is None else self._acceleration(motion, start, 0.0, 0.0)
        rows, at = [(0.0, start, 0.0, 0.0, 0.0)], None
        for step in steps:
            s, share = 1.0 / (GAMMA * step), (1.0 - GAMMA) / GAMMA
            base, base_flux = held, flux
            for part in (GAMMA, 1.0):
                place = distance + part * step * velocity + 0.5 * (part * step) ** 2 * acceleration
                if place != at:
                    self.moving.move_to(place)
                    stage.move()
                    at = place
                stage.set(s, base, base_flux, volts)
                found = minimise(stage, np.zeros(1), w, tolerance=TOLERANCE)
                assert found.converged, found.history
                w = found.state
                now, linked = self.points.rows(w[None])[0], inner(stage.load, w)
                base, base_flux = held + share * (now - held), flux + share * (linked - flux)
            held, flux, current = now, linked, stage.current(w)
            pull = self.force(w, current)
            distance, time = place, time + step
            if until is not None:
                after = self._acceleration(motion, distance, velocity, pull)
                velocity, acceleration = velocity + 0.5 * step * (acceleration + after), after
            rows.append((time, distance, current, flux, pull))
            if until is not None and distance <= until:
                break
        self.moving.move_to(self.moving.reference)
        return np.array(rows).T

    @staticmethod
    def _acceleration(motion, distance, velocity, force):
        return float(motion.acceleration(np.array(distance), np.array(velocity), np.array(force), 1e-3))


def octaves(first, last, count):
    """Steps in s that double from octave to octave, so many in each: a step of voltage has no time of its own."""
    octave = np.arange(np.ceil(np.log2(last / first)))
    return np.repeat(first / count * np.r_[1.0, 2.0**octave], count)


def departures(ours, exact):
    """Largest differences of currents and of flux linkages at any instant, over their final values."""
    return [float(np.abs(one - other).max() / abs(other[-1])) for one, other in zip(ours, exact, strict=True)]


@cache
def pot_step():
    """Of a pot's step from drawing to model: what halving the time steps changes, and how far off the model is.

    Largest differences of the current, the current and the flux linkage over their final values, between two distances
    of the sweep.
    """
    text = POT.replace("start = 10, stop = 1000, per_decade = 2", "start = 1, stop = 10000, per_decade = 1")
    text = text.replace("[1, 1.5, 2, 2.5]", "[1, 1.25, 1.5, 1.75, 2]")
    actuator = actuator_from_toml(text.replace("eddy_error = 0.02", "eddy_error = 0.01"))
    with TemporaryDirectory() as directory:
        model = ff.fit_model(ff.run_sweep(actuator, directory, workers=1)).model
    distance, size = 1.6e-3, 1 + model.eddy.count
    body = [replace(one, material=replace(one.material, remanence_T=0.0)) for one in actuator.moving.regions]
    still = replace(
        actuator, moving=replace(actuator.moving, regions=tuple(body))
    )  # beside magnets, nothing rests at 0
    field = FieldInTime(still, [distance], ORDER, 16e3)
    coarse, fine = (field.run(1.0, distance, octaves(1e-5, 0.1, steps))[[0, 2, 3]] for steps in (4, 8))
    inductances = model.windings.magnetics.inductance(np.array(distance), np.zeros(size))
    ours = step_of_windings(inductances, model.windings.resistances_ohm, 1.0, fine[0])
    return departures([coarse[1]], [fine[1][::2]]) + departures(ours, fine[1:])
