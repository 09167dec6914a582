"""Problems with a known answer, each as a number that the field solver gives.

The tests of ``tests/physics`` and the page ``docs/validation.md`` take their numbers from here.
"""

import math
from functools import cache

import magpylib
import ngsolve as ng
import numpy as np
from netgen.occ import Glue, OCCGeometry, WorkPlane
from ngsolve import H1, LinearForm, Mesh, dx
from scipy import special
from scipy.integrate import quad

from femfit.core.numerics import MU_0
from femfit.device.electrics import HallElement
from femfit.device.parts import Coil, LinearMaterial, Region
from femfit.field.tolerance import SolverSettings
from femfit.field.weak_form import flux_density, stiffness
from support.actuators import assembly, device, magnet, rectangle
from support.field import fields, finer_settings, prepared, solved
from support.reference import REFERENCE
from support.saturating import bobbin, rows_at

DUMMY = 1e-6
"""Remanence in T of a magnet that is there only because an assembly has a moving part."""


def loops_exact(a, b, z):
    """M and dM/dz of coaxial loops in H and H/m, by elliptic integrals (Maxwell) and by magpylib's radial field."""
    k2 = 4.0 * a * b / ((a + b) ** 2 + z**2)
    k = math.sqrt(k2)
    mutual = MU_0 * math.sqrt(a * b) * ((2.0 / k - k) * special.ellipk(k2) - 2.0 / k * special.ellipe(k2))
    return mutual, -2.0 * math.pi * b * magpylib.current.Circle(current=1.0, diameter=2.0 * a).getB((b, 0.0, z))[0]


LOOP_SIDE = 0.01
"""Side of a coil's section that stands for a loop, over its radius: it changes M by its square over 24."""


def thin_coil(radius, height=0.0, **options):
    """A loop as a coil of small square section, its middle at a height."""
    half = 0.5 * LOOP_SIDE * radius
    section = rectangle(radius - half, radius + half, height - half, height + half)
    return Coil(section, 1.0, 1.0, **options)


def pair_of_loops(a, b, z):
    """A fixed loop of radius a and a moving one of radius b at z, each in a circuit of its own."""
    half = 0.5 * LOOP_SIDE * b
    coils = [thin_coil(a, name="fixed"), thin_coil(b, half, moves=True, name="moving")]
    return device("loops", coils=coils, currents=((0.0, 1.0), (0.0, 1.0)), distances=(z - half,))


@cache
def two_coils(a, b, z):
    """M in H and force in N at 1 A in both, of a fixed loop and a moving one at z."""
    actuator = pair_of_loops(a, b, z)
    (distance,) = actuator.sweep.distances_m
    solution = prepared(actuator, distance).solve(distance)
    return solution.flux_linkage[0, 2], 2.0 * solution.force[1, 2]


RING = (0.008, 0.015, 0.0, 0.006)
"""Inner and outer radius and ends in m of a ring magnetised radially with 1.2 T."""


def radial_ring(height):
    """B_z in T on the axis of the ring."""
    material = LinearMaterial("radial", 1.0, 1.2, direction=(1.0, 0.0))
    ring, sensor = Region("ring", rectangle(*RING), material), HallElement(0.0, height)
    body = magnet(1e-9, 0.002, 0.002)
    actuator = device("ring", fixed=[ring], moving=[body], distances=(0.05,), sensors=[sensor])
    return prepared(actuator, 0.05).solve(0.05).hall[0]


def radial_ring_exact(z):
    """The same from the charge of its mantles, +-B_r, and of its volume, -B_r / r."""
    inner, outer, low, high = RING

    def ends(primitive):
        return 0.5 * 1.2 * (primitive(z - high) - primitive(z - low))

    mantles = ends(lambda h: outer / math.hypot(outer, h) - inner / math.hypot(inner, h))
    return mantles - ends(lambda h: math.asinh(outer / abs(h)) - math.asinh(inner / abs(h)))


def brooks(settings=None):
    """L per turn squared of a square section of 10 mm on an inner radius of 10 mm."""
    coil = rectangle(0.01, 0.02, -0.02, -0.01)
    actuator = assembly(moving=[magnet(DUMMY, 0.001, 0.001)], distances=(0.1,), coil=coil, turns=1)
    return solved(actuator, settings=settings).flux_linkage[1]


def brooks_exact():
    """The same: loops' mutual inductance averaged over the section, one integral over k."""
    r1, r2, length = 0.01, 0.02, 0.01

    def moment(x):
        """Integral of x J_1(x) from 0."""
        return 0.5 * math.pi * x * (special.j1(x) * special.struve(0, x) - special.j0(x) * special.struve(1, x))

    def share(k):
        return (moment(k * r2) - moment(k * r1)) ** 2 * 2.0 * (k * length + math.expm1(-k * length)) / k**6

    total = quad(share, 1e-3 / r2, 600.0 / r2, limit=1000, epsabs=0.0, epsrel=1e-9)[0]
    return MU_0 * math.pi * total / ((r2 - r1) * length) ** 2


def magnet_pair(remanence, fixed, moving, gap):
    """Pull in N of two coaxial cylinder magnets, each (radius, height) in m."""
    lower = magnet(remanence, fixed[0], fixed[1], z_min=-fixed[1], name="lower")
    return solved(assembly(fixed=[lower], moving=[magnet(abs(remanence), *moving)], distances=(gap,))).force[0]


def axis_field(height):
    """B_z at a height above the seed magnet's face, J = 1.44 T, 11 mm x 5 mm."""
    actuator = assembly(moving=[magnet(1.44, 0.0055, 0.005)], distances=(0.05,), hall=(0.0, 0.05 - height))
    return solved(actuator).hall[0]


def axis_field_of_cylinder(remanence, radius, height, z):
    """B_z on the axis at z above the upper face of a uniformly magnetised cylinder."""
    return remanence / 2.0 * ((z + height) / np.hypot(radius, z + height) - z / np.hypot(radius, z))


def thick_coil_axis(height):
    """B_z in T of 1 A on the axis of the rig's winding."""
    coil = rectangle(0.01, 0.02, -0.02, -0.005)
    body = magnet(DUMMY, 0.005, 0.005)
    return solved(assembly(moving=[body], distances=(0.06,), coil=coil, turns=308, hall=(0.0, height))).hall[1]


def thick_coil_axis_exact(height):
    """The same in closed form."""
    r1, r2, z1, z2 = 0.01, 0.02, -0.02, -0.005

    def primitive(s):
        return s * math.log((r2 + math.hypot(r2, s)) / (r1 + math.hypot(r1, s)))

    return MU_0 * 308.0 / (2.0 * (r2 - r1) * (z2 - z1)) * (primitive(height - z1) - primitive(height - z2))


def coil_on_magnet_exact(offset):
    """|F| in N of a current sheet of 100 turns with 1 A on a magnet of J = 1 T, from magpylib's exact field."""
    body = magpylib.magnet.Cylinder(polarization=(0, 0, 1.0), dimension=(0.03, 0.015), position=(0, 0, 0))
    nodes, weights = np.polynomial.legendre.leggauss(60)
    z = -offset + 0.01 * nodes
    radial = body.getB(np.stack([np.full_like(z, 0.02), 0 * z, z], axis=1))[:, 0]
    return abs(2.0 * math.pi * 0.02 * 100.0 * 0.5 * np.sum(weights * radial))


def coil_on_magnet(offset):
    """The same from the field solver, the sheet as a winding of 0.4 mm."""
    middle = 0.1 + 0.0075 - offset
    coil = rectangle(0.0198, 0.0202, middle - 0.01, middle + 0.01)
    actuator = assembly(moving=[magnet(1.0, 0.015, 0.015)], distances=(0.1,), coil=coil, turns=100)
    return abs(solved(actuator).force[1])


def image_of_a_magnet(permeability):
    """F in N of the cylinder magnet of :func:`magnet_pair` 5 mm above a wide thick plate."""
    plate = Region("plate", rectangle(0.0, 1.0, -0.8, 0.0), LinearMaterial("iron", permeability))
    coil = rectangle(1.2, 1.25, -0.1, -0.05)
    return solved(assembly(fixed=[plate], moving=[magnet(1.3, 0.02, 0.04)], distances=(0.005,), coil=coil)).force[0]


def ball(permeability, inner=None):
    """B / B_0 at the centre of a sphere, or of a shell with an inner radius, in a uniform field; outer radius 1."""
    radius, order = 3.0, 6

    def half(r):
        return WorkPlane().MoveTo(0.0, -r).Arc(r, 180.0).Close().Face()

    body, air = half(1.0), half(radius) - half(1.0)
    pieces = [body, air]
    if inner is not None:
        hollow = half(inner)
        body = body - hollow
        hollow.faces.name = "air"
        pieces = [body, hollow, air]
    body.faces.name, body.faces.maxh, air.faces.name = "body", 0.1, "air"
    shape = Glue(pieces)
    for edge in shape.edges:
        if math.hypot(edge.center.x, edge.center.y) > 0.9 * radius or edge.center.x > 1.2:
            edge.name = "outer"
    mesh = Mesh(OCCGeometry(shape, dim=2).GenerateMesh(maxh=0.5))
    mesh.Curve(order)
    space = H1(mesh, order=order)
    v = space.TestFunction()
    # w = 1/2 is the applied field; the body answers for what its reluctivity differs from air's
    extra = (1.0 - 1.0 / permeability) / MU_0
    load = LinearForm(extra * flux_density(v)[1] * 2.0 * math.pi * ng.x * dx("body", bonus_intorder=3)).Assemble()
    nu = mesh.MaterialCF({"body": 1.0 / (permeability * MU_0)}, default=1.0 / MU_0)
    form = stiffness(space, nu, radius, condense=False).Assemble()
    w = ng.GridFunction(space)
    w.vec.data = form.mat.Inverse(space.FreeDofs(), inverse="umfpack") * load.vec
    return 1.0 + flux_density(w)[1](mesh(1e-9, 0.0))


def shell_exact(permeability, ratio):
    """What a shell of inner over outer radius leaves of the field."""
    outer = (2.0 * permeability + 1.0) * (permeability + 2.0)
    return 9.0 * permeability / (outer - 2.0 * ratio**3 * (permeability - 1.0) ** 2)


def team_23(permeability):
    """Force in N at 50 mA in TEAM problem 23: SmCo magnet, air coil of 280 turns, as coded in Ansys VM270."""
    coil = rectangle(1.524e-3, 1.9812e-3, -1.524e-3, 0.0)
    body = magnet(1.02, 0.5 * 2.9972e-3, 1.6e-3, permeability=permeability)
    return 0.05 * solved(assembly(moving=[body], distances=(0.361e-3,), coil=coil, turns=280)).force[1]


LDX_LIFT = (0.246, 0.70, 0.1, 3500.0 * 80.0)
"""Levitation coil: inner and outer radius, length, ampere turns; its lower face lies 1.525 m above the middle."""

LDX_FLOAT = ((0.2717, 0.01152, 0.0694, 26.6), (0.28504, 0.01508, 0.125, 81.7), (0.33734, 0.08936, 0.1615, 607.7))
"""Floating coil's three parts about the middle: mean radius, width, length, turns with 1629 A."""


def ldx_mass():
    """Mass in kg that the levitated dipole's coils carry with g = 9.81: the Lorentz force on the floating coil."""
    r1, r2, length, ampere_turns = LDX_LIFT
    actuator = assembly(
        moving=[magnet(DUMMY, 0.05, 0.05)], distances=(3.0,), coil=rectangle(r1, r2, -length, 0.0), turns=ampere_turns
    )
    problem = prepared(actuator, 3.0)
    w = fields(problem, 3.0)[1]
    nodes, weights = np.polynomial.legendre.leggauss(12)
    force = 0.0
    for middle, width, height, turns in LDX_FLOAT:
        r, z = np.meshgrid(middle + 0.5 * width * nodes, 1.525 + 0.5 * height * nodes)
        radial = flux_density(w)(problem.mesh(r.ravel(), z.ravel()))[:, 0].reshape(r.shape)
        force += 2.0 * math.pi * turns * 1629.0 * 0.25 * np.einsum("ij,i,j->", radial * r, weights, weights)
    return abs(force) / 9.81


def difference_from_peer(name, worst=False):
    """Median (or largest) |F / F_peer - 1| over a table of the peer's for the steel disc before a bobbin of steel."""
    ours, peer = _peer_rows(name)
    difference = np.abs(ours / peer - 1.0)
    return float(difference.max() if worst else np.median(difference))


@cache
def _peer_rows(name):
    import pandas as pd

    table = pd.read_csv(REFERENCE / name)
    table = table[table["current_A"] > 0.0]
    ours, peer = [], []
    for distance, rows in table.groupby(table["distance_m"].round(6)):
        currents = tuple(sorted(rows["current_A"]))
        actuator = bobbin(distances=(float(distance),), currents=currents)
        force = dict(zip(currents, rows_at(actuator)["force_N"], strict=True))
        ours += [force[i] for i in rows["current_A"]]
        peer += list(rows["force_N"])
    return np.array(ours), np.array(peer)


FINER = finer_settings(SolverSettings())
