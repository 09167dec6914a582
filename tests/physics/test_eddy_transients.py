"""Eddy currents in time: a solenoid that pulls in, a step of voltage, and a magnet that a tube brakes.

The field goes in implicit steps, of which each stage minimises an energy: that of the static field, what the induced
currents cost, and the supply's. Nothing of it is of the reduced models that it checks.
"""

import ngsolve as ng
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import femfit as ff
from femfit.device.load import actuator_from_toml
from femfit.field.eddy_probe import EddyProbe
from femfit.field.eddy_sweep import ORDER
from femfit.field.harmonic import ConductorPoints, add_eddy_form, conductors
from femfit.field.layout import layout_of
from femfit.field.moving_mesh import MovingMesh
from femfit.field.newton import Expansion, inner, minimise
from femfit.field.nonlinear_system import NonlinearSystem, SummedInverse
from femfit.field.source_fields import SourceFields
from femfit.field.tolerance import SolverSettings
from femfit.field.weak_form import LayerForce
from femfit.model.dynamics import state_derivative
from support import falling_magnet as fall
from support.eddy_transient import GAMMA, mesh_for, pot_step
from support.small_drawing import DRAWINGS

FLAT = (DRAWINGS / "flat-solenoid.toml").read_text(encoding="utf-8")
NEAR, FAR = 0.4e-3, 1.2e-3  # from where to where it is pulled

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


class PullIn:
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


def switched_field(volts, step):
    """The pull-in of the flat solenoid by the field, as of :meth:`PullIn.run`; the first step in fifths."""
    field = PullIn(actuator_from_toml(FLAT), np.linspace(NEAR, FAR, 7), 3, 1000.0)
    return field.run(volts, FAR, np.r_[np.full(5, step / 5.0), np.full(1000, step)], until=NEAR)


def switched_model(model, volts, times):
    """The same of a model: when it is there in s, and currents at times."""

    def rates(_, x):
        return state_derivative(model, x[None], np.array([volts]))[0]

    def there(_, x):
        return x[0] - NEAR

    there.terminal = True
    rest = np.zeros(model.order)
    rest[0] = FAR
    found = solve_ivp(
        rates, (0.0, 2.0 * times[-1]), rest, "Radau", events=there, rtol=1e-6, atol=1e-9, dense_output=True
    )
    (end,) = found.t_events[0]
    return end, found.sol(np.minimum(times, end))[2]


STEP = 2e-4


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return ff.fit_model(ff.run_sweep(actuator_from_toml(FLAT), tmp_path_factory.mktemp("flat"), workers=2)).model


@pytest.mark.nightly
@pytest.mark.parametrize("volts", [6.0, 12.0, 24.0])
def test_solid_steel_switches_late_and_the_model_says_by_how_much(model, volts):
    times, distances, currents, *_ = switched_field(volts, STEP * 12.0 / volts)
    exact = float(np.interp(-NEAR, -distances, times))  # when the body is at the near end
    late, found = switched_model(model, volts, times)
    static, plain = switched_model(model.without_eddies, volts, times)
    assert static < 0.97 * exact  # 3 to 6 % early
    assert abs(late - exact) < min(0.03 * exact, 0.6 * abs(static - exact))
    early = times < 0.8 * exact
    off, unlagged = (np.abs(one - currents)[early].max() / currents.max() for one in (found, plain))
    assert off < 0.75 * unlagged


@pytest.mark.nightly
def test_the_field_in_time_ends_in_the_static_state():
    actuator = actuator_from_toml(FLAT)
    field = PullIn(actuator, [FAR], 2, 30.0)
    _, distances, currents, flux, force = field.run(2.0, FAR, np.geomspace(1e-4, 0.1, 24))
    assert set(distances) == {FAR}
    assert currents[-1] == pytest.approx(2.0 / actuator.circuits[0].resistance_ohm, rel=1e-4)
    held = SourceFields(field.moving, actuator, 2)
    held.bias = currents[-1:]
    at_rest = held.evaluate()
    assert flux[-1] == pytest.approx(at_rest.flux_linkage[0, 0], rel=1e-4)
    assert force[-1] == pytest.approx(at_rest.force[0, 0], rel=1e-3)
    assert (np.diff(flux) > 0.0).all()


def test_without_a_winding_there_is_braking_and_nothing_else():
    actuator = fall.drawing()
    found, _ = EddyProbe(actuator, mesh_for(actuator, 0.0, 10.0), 0.0, ORDER).transfers(np.array([10.0]))
    assert found.flux_linkage.shape == (1, 0, 0)
    assert found.force.shape == (1, 1, 0)


@pytest.mark.nightly
def test_a_step_of_voltage_on_a_solid_pot_is_that_of_the_field():
    steps, current, flux = pot_step()
    assert steps < 0.001  # what halving the time steps changes
    assert max(current, flux) < 0.01  # as asked for


@pytest.mark.nightly
def test_a_magnet_falls_through_a_tube_as_fast_as_its_weight_is_braked():
    model, late = fall.fallen()
    distances = np.linspace(-8.9e-3, 8.9e-3, 200)
    braking = (model.eddy.forms(distances, 1)[0].flux_linkage ** 2).sum(axis=-1)
    exact = fall.braking_of_cylinder(fall.RADIUS)
    assert np.abs(braking / exact - 1.0).max() < 0.005  # as asked for, between the sweep's distances too
    weight = fall.MASS * fall.GRAVITY
    assert fall.speed() == pytest.approx(weight / exact, rel=0.002)
    heat = sum(late[name] ** 2 for name in model.eddy_names)  # each of 1 ohm
    mean = np.trapezoid(heat, late["time_s"]) / np.ptp(late["time_s"])
    assert mean == pytest.approx(weight * fall.speed(), rel=0.002)
