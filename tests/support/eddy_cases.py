"""Coils beside conductors whose impedance is known, as inductances from the field at a complex frequency."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import ngsolve as ng

from femfit.core.numerics import MU_0
from femfit.device.outlines import circle
from femfit.device.parts import AIR, Coil, LinearMaterial, Region
from femfit.field.harmonic import HarmonicSystem, conductors
from femfit.field.layout import layout_of
from femfit.field.material_points import MaterialPoints
from femfit.field.moving_mesh import MovingMesh
from femfit.field.tolerance import SolverSettings
from femfit.field.weak_form import flux_density, materials, source_loads
from support import eddy_exact
from support.actuators import device, rectangle

COPPER, STEEL, VACUUM = (58e6, 1.0), (6e6, 100.0), (0.0, 1.0)
"""Conductivity in S/m and mu_r."""

IDEAL = LinearMaterial("ideal iron", 1e8)


def material(body, lamination=0.0, name="conductor"):
    """A LinearMaterial of (conductivity in S/m, mu_r)."""
    return LinearMaterial(name, body[1], conductivity_S_per_m=body[0], lamination_m=lamination)


def drawing(fixed, sections, turns=100.0, size=None):
    """Fixed regions and coils, under a small disc of nothing that stands for the moving part."""
    size = size or min(section[1] for section in sections)
    top = max([z for part in fixed for _, z in part.vertices_m] + [section[3] for section in sections])
    coils = [Coil(rectangle(*one), turns, 1.0, name=f"coil {k}") for k, one in enumerate(sections)]
    disc = Region("nothing", rectangle(0.0, 0.2 * size, 0.0, 0.2 * size), AIR)
    currents = ((0.0,),) * len(coils)
    return device("eddies", fixed=fixed, coils=coils, moving=[disc], currents=currents, distances=(top + size,))


class Harmonic:
    """A drawing at its first distance, meshed for a highest frequency in Hz."""

    def __init__(self, actuator, frequency, **settings):
        self.settings = SolverSettings(skin_frequency_Hz=frequency, **settings)
        layout = layout_of(actuator, self.settings)
        self.actuator, self.distance = actuator, actuator.sweep.distances_m[0]
        self.moving = MovingMesh(actuator, (self.distance,), layout, self.settings)

    def solve(self, s):
        """Inductances in H between the circuits at s in 1/s, and the fields of 1 A in each as GridFunctions."""
        real = not isinstance(s, complex)
        with self.moving.at(self.distance):
            space = ng.H1(self.moving.mesh, order=self.settings.order)
            points = MaterialPoints(space, materials(self.actuator))
            system = HarmonicSystem(self.moving, self.actuator, points, real=real)
            system.move()
            loads = source_loads(space, self.actuator)
            w = system.solve(s, loads)
            fields = [ng.GridFunction(system.space) for _ in w]
            for field, one in zip(fields, w, strict=True):
                field.vec.FV().NumPy()[:] = one
        return loads @ w.T, fields


def inductance(actuator, s, **settings):
    """Of the only circuit in H at s in 1/s, on a mesh for |s|."""
    return Harmonic(actuator, abs(s) / (2.0 * math.pi), **settings).solve(s)[0][0, 0]


def added(case, body, s, **settings):
    """What a body adds to a coil's inductance in H: the case with it less the case with air in its place."""
    return inductance(case(body), s, **settings) - _without(case, tuple(settings.items()))


@cache
def _without(case, settings):
    return inductance(case(VACUUM), 1.0, **dict(settings))


PLATE_COIL = (0.01, 0.02, 0.002, 0.006)


def plate(body, *, radius=0.1, thickness=0.03):
    """A coil of 10 to 20 mm, 2 mm above a round plate."""
    return drawing([Region("plate", rectangle(0.0, radius, -thickness, 0.0), material(body))], [PLATE_COIL])


ROD_COIL = (0.01, 0.014, -0.005, 0.005)
ROD = 0.008


def rod(body, *, length=0.4):
    """A coil of 10 to 14 mm around the middle of a rod of 8 mm."""
    half = 0.5 * length
    return drawing([Region("rod", rectangle(0.0, ROD, -half, half), material(body))], [ROD_COIL], size=0.02)


CORE, CORE_COIL = 0.005, (0.006, 0.009, 0.0, 0.02)
"""Radius of a core, and the coil that fills its window, in m."""


def core(body, lamination=0.0):
    """A round core and a coil as long as it within ideal iron: H_z does not depend on z, as in an infinite solenoid."""
    _, outside, low, high = CORE_COIL
    frame = ((0, low - 0.01), (outside + 0.01, low - 0.01), (outside + 0.01, high + 0.01), (0, high + 0.01))
    window = ((0, high), (outside, high), (outside, low), (0, low))
    iron = [
        Region("bottom", (frame[0], frame[1], (frame[1][0], low), window[3]), IDEAL),
        Region("top", (window[0], (frame[1][0], high), frame[2], frame[3]), IDEAL),
        Region("shell", rectangle(outside, frame[1][0], low, high), IDEAL),
    ]
    middle = Region("core", rectangle(0.0, CORE, low, high), material(body, lamination))
    return drawing([*iron, middle], [CORE_COIL], size=0.02)


def core_exact(s, body, ratio, turns=100.0):
    """L of that coil in H: a core whose flux is a ratio of that at rest, the air beside it, and the winding."""
    inside, outside, low, high = CORE_COIL
    wide = outside - inside
    winding = wide * (inside / 3.0 + wide / 12.0)  # int ((outside - r) / wide)^2 r dr, of which H^2 is made
    areas = math.pi * (body[1] * ratio * CORE**2 + inside**2 - CORE**2 + 2.0 * winding)
    return MU_0 * turns**2 / (high - low) * areas


BALL, BALL_COIL = 0.01, (0.03, 0.04, 0.012, 0.02)


def ball(body):
    """A ball of 10 mm within a larger coil, off its middle."""
    corners, bulges = circle((0.0, 0.0), BALL)
    return drawing([Region("ball", tuple(corners), material(body), tuple(bulges))], [BALL_COIL], size=0.02)


@dataclass(frozen=True)
class Known:
    """A case with its closed form, an inductance in H of (s, body), and how the field solver's is counted."""

    name: str
    source: str
    case: Callable
    exact: Callable
    counted: Callable = added


PLATE_CASE = Known(
    "coil above a {} plate",
    "Dodd and Deeds",
    plate,
    partial(eddy_exact.above_plate, section=PLATE_COIL, turns=100.0, thickness=0.03),
)
CORE_CASE = Known(
    "round {} core",
    "Bessel functions",
    core,
    lambda s, body: core_exact(s, body, eddy_exact.core_ratio(s, body, CORE)),
    lambda case, body, s, **settings: inductance(case(body), s, **settings),
)
BALL_CASE = Known(
    "{} ball in a coil",
    "spherical Bessel functions",
    ball,
    partial(eddy_exact.around_sphere, radius=BALL, section=BALL_COIL, turns=100.0),
)
KNOWN = (
    PLATE_CASE,
    Known(
        "coil around a {} rod",
        "Dodd and Deeds",
        rod,
        partial(eddy_exact.around_rod, radius=ROD, section=ROD_COIL, turns=100.0),
    ),
    CORE_CASE,
    BALL_CASE,
)


def exact(case, body, frequency):
    """R in ohm and L in H of a known case."""
    s = 2j * math.pi * frequency
    found = case.exact(s, body)
    return (s * found).real, found.real


@cache
def solved(case, body, frequency):
    """The same from the field, with the default settings."""
    s = 2j * math.pi * frequency
    found = case.counted(case.case, body, s)
    return (s * found).real, found.real


def loss(harmonic, s, field):
    """Integral of sigma |s|^2 r^2 |w|^2 2 pi r over what conducts, sheets by their mean eddies, in W for 1 A rms."""
    total, r = 0.0, ng.x
    for name, one in conductors(harmonic.actuator).items():
        b = flux_density(field)
        density = r**2 * ng.InnerProduct(field, field)
        if one.lamination_m:
            density = one.lamination_m**2 / 12.0 * ng.InnerProduct(b, b)
        power = one.conductivity_S_per_m * abs(s) ** 2 * density * 2.0 * math.pi * r
        mesh = harmonic.moving.mesh
        with harmonic.moving.at(harmonic.distance):
            total += ng.Integrate(power, mesh, definedon=mesh.Materials(name), order=4 * harmonic.settings.order).real
    return total
