"""Networks of nodes, windings and faces beside closed forms and conduction on a fine grid.

On the grid of (r, z) every cell is one volume, whatever part it is of: winding, iron and magnet conduct in full, and
the air of narrow gaps and closed pockets conducts; where parts touch is the joint's air. Free faces have the film. What
is open air is told by discs as wide as the widest gap that come from far away.
"""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse as sp
import shapely
from scipy import ndimage
from scipy.integrate import quad
from scipy.sparse.linalg import spsolve

from femfit.core.numerics import COPPER_TEMPERATURE_COEFFICIENT as ALPHA
from femfit.device.load import read_actuator
from femfit.device.parts import Coil
from femfit.device.thermal import AIR_CONDUCTIVITY, thermal_of
from femfit.heat.balance import largest_factor, settled, time_until
from femfit.heat.network import NOTHING, OPEN, HeatNetwork, faces_of, heat_network, stars, winding_heat
from support.actuators import GEOMETRY


def rises_of(network, ambient=0.0):
    """Temperatures of all parts by a watt in each winding."""
    heat = np.zeros(len(network.names))
    heat[: len(network.windings)] = 1.0
    return np.linalg.solve(network.laplacian, network.outwards * ambient + heat)


@pytest.mark.parametrize("name", ["pot-magnet", "solenoid", "emaws-rig", "voice-coil", "bearing", "ball"])
def test_what_is_put_in_comes_out(name):
    actuator = read_actuator(GEOMETRY / f"{name}.toml")
    network = heat_network(actuator, actuator.sweep.distances_m[0])
    rise = rises_of(network)
    assert network.outwards @ rise == pytest.approx(len(network.windings))
    assert np.allclose(network.between, network.between.T)
    assert np.linalg.eigvalsh(network.laplacian)[0] > 0.0
    assert np.allclose(network.inside.sum(axis=1), 0.0)


OUTSIDE, AIR = -2, -1
STEP = 0.5e-3
FEWEST = 8  # cells between two edges of the drawing


def rises(actuator, distance):
    """Mean and largest temperature over ambient of coils, fixed and moving regions, by a watt in each coil."""
    around = actuator.thermal
    parts = [*actuator.coils, *actuator.fixed, *actuator.moving.regions]
    moves = [part in actuator.moving.regions or getattr(part, "moves", False) for part in parts]
    places = [part.vertices_m + np.array([0.0, distance * moved]) for part, moved in zip(parts, moves, strict=True)]
    shapes = [shapely.Polygon(one) for one in places]
    corners = np.concatenate([np.array(one.exterior.coords) for one in shapes])
    r, z = grid_lines([0.0, *corners[:, 0]]), grid_lines(corners[:, 1])
    middle = np.stack(np.meshgrid(*(0.5 * (one[1:] + one[:-1]) for one in (r, z)), indexing="ij"), axis=-1)
    owner = np.full(middle.shape[:2], AIR)
    for k, shape in enumerate(shapes):
        owner[shapely.contains_xy(shape, middle[..., 0], middle[..., 1])] = k
    owner[(owner == AIR) & open_air(shapes, middle, 2.0 * AIR_CONDUCTIVITY / around.film_W_per_m2_K)] = OUTSIDE
    solid = [
        winding_heat(part, around.insulation_W_per_m_K) if isinstance(part, Coil) else thermal_of(part.material)
        for part in parts
    ]
    known = np.array([*(one.conductivity_W_per_m_K for one in solid), 0.0, AIR_CONDUCTIVITY])  # the last by -2 and -1
    volume = np.pi * np.diff(r**2)[:, None] * np.diff(z)
    own = [owner == k for k in range(len(parts))]
    heat = sum(volume * cells / (volume * cells).sum() for cells in own[: len(actuator.coils)])
    field = solved(owner, known[owner], r, z, heat, around, len(actuator.coils))
    return [(float((field * volume)[cells].sum() / volume[cells].sum()), float(field[cells].max())) for cells in own]


def grid_lines(coordinates):
    edges = np.unique(np.round(coordinates, 9))
    pieces = [np.linspace(a, b, max(FEWEST, int(np.ceil((b - a) / STEP))) + 1)[:-1] for a, b in pairwise(edges)]
    return np.append(np.concatenate(pieces), edges[-1])


def open_air(shapes, middle, widest):
    """Which places a disc of that diameter covers that comes from far away and touches no part."""
    pixel, margin = widest / 54.0, 2.0 * widest
    high, low = middle[-1, -1] + margin, middle[0, 0, 1] - margin
    axes = np.arange(-high[0], high[0], pixel), np.arange(low, high[1], pixel)
    across, along = np.meshgrid(*axes, indexing="ij")
    solid = np.any([shapely.contains_xy(shape, np.abs(across), along) for shape in shapes], axis=0)
    centres = (ndimage.distance_transform_edt(~solid) - 0.5) * pixel >= 0.5 * widest
    labels, _ = ndimage.label(centres)
    covered = (ndimage.distance_transform_edt(labels != labels[0, 0]) - 0.5) * pixel < 0.5 * widest
    at = [np.clip(np.searchsorted(axis, middle[..., k]), 0, len(axis) - 1) for k, axis in enumerate(axes)]
    return covered[at[0], at[1]]


def solved(owner, known, r, z, heat, around, windings):
    """Temperatures over ambient of all cells."""
    number = np.where(owner == OUTSIDE, -1, np.cumsum(owner != OUTSIDE).reshape(owner.shape) - 1)
    dz, mid = np.diff(z), 0.5 * (r[1:] + r[:-1])
    loss, entries = np.zeros(number.max() + 1), []
    # Along r, then along z: faces between cells, and the way from each cell's middle to its lower and its upper face
    inner = r[:-1] * np.log(mid / np.maximum(r[:-1], 1e-12))
    radial = 2.0 * np.pi * r[:, None] * dz, inner[:, None], (r[1:] * np.log(r[1:] / mid))[:, None]
    axial = np.pi * np.diff(r**2)[:, None] * np.ones(len(z)), 0.5 * dz, 0.5 * dz
    film, size = 1.0 / around.film_W_per_m2_K, owner.shape
    for axis, (area, down, up) in enumerate((radial, axial)):
        low, high = (np.take(area, range(a, b), axis) for a, b in ((0, size[axis]), (1, size[axis] + 1)))
        with np.errstate(divide="ignore", invalid="ignore"):
            ways = np.broadcast_to(down, size) / known, np.broadcast_to(up, size) / known
        first, last = range(size[axis] - 1), range(1, size[axis])
        one, other = np.take(owner, first, axis), np.take(owner, last, axis)
        joint = np.where(np.minimum(one, other) < windings, around.winding_joint_m, around.joint_m) / AIR_CONDUCTIVITY
        joint = np.where((one >= 0) & (other >= 0) & (one != other), joint, 0.0)
        both = (one != OUTSIDE) & (other != OUTSIDE)
        way = np.take(ways[1], first, axis) + joint + np.take(ways[0], last, axis)
        g = np.take(high, first, axis)[both] / way[both]
        a, b = np.take(number, first, axis)[both], np.take(number, last, axis)[both]
        entries += [(a, a, g), (b, b, g), (a, b, -g), (b, a, -g)]
        beyond = np.pad(owner, [(1, 1) if k == axis else (0, 0) for k in (0, 1)], constant_values=OUTSIDE)
        if axis == 0:
            beyond[0] = AIR  # nothing crosses the axis
        for face, path, start in ((low, ways[0], 0), (high, ways[1], 2)):
            free = (owner >= 0) & (np.take(beyond, range(start, start + size[axis]), axis) == OUTSIDE)
            np.add.at(loss, number[free], face[free] / (path[free] + film))
    rows, columns, values = (np.concatenate(one) for one in zip(*entries, strict=True))
    matrix = sp.coo_matrix((values, (rows, columns)), shape=(len(loss),) * 2).tocsc() + sp.diags(loss, format="csc")
    inside = owner != OUTSIDE
    rise = spsolve(matrix, heat[inside])
    assert np.isclose(loss @ rise, heat.sum(), rtol=1e-8)
    return np.where(inside, rise[number], 0.0)


CASES = {
    ("pot-magnet", 0.5e-3): 0.06,
    ("plunger-solenoid", 0.5e-3): 0.02,
    ("plunger-solenoid", 10e-3): 0.02,
    ("emaws-rig", 22e-3): 0.02,
    ("voice-coil", -6e-3): 0.09,
    ("bearing", 0.5e-3): 0.03,
}


@pytest.mark.parametrize(("name", "distance"), CASES)
def test_the_network_is_near_conduction_on_a_fine_grid(name, distance):
    """The parts' rises within a share of the winding's; the howto says by how much."""
    actuator = read_actuator(GEOMETRY / f"{name}.toml")
    network = heat_network(actuator, distance)
    rise, count = rises_of(network), len(actuator.coils)
    exact = np.array(rises(actuator, distance))
    assert rise[:count] == pytest.approx(exact[:count, 0], rel=CASES[name, distance])
    assert np.abs(rise - exact[:, 0]).max() < max(CASES[name, distance], 0.045) * exact[0, 0]
    hottest = rise[:count] + network.inside @ np.append(rise, 0.0)
    assert hottest == pytest.approx(exact[:count, 1], rel=0.05)


def test_a_mounting_cools_the_heaviest_fixed_part():
    actuator = read_actuator(GEOMETRY / "pot-magnet.toml")
    cooled = replace(actuator, thermal=replace(actuator.thermal, mounting_W_per_K=1e6))
    network = heat_network(cooled, 1e-3)
    assert rises_of(network, 20.0)[network.names.index("pot")] == pytest.approx(20.0, abs=1e-4)


G, C = 0.1, 50.0
NODE = HeatNetwork((), (None,), (), np.array([C]), np.zeros((1, 1)), np.array([G]), np.zeros((0, 2)))


def test_one_node_settles_at_heat_over_conductance_less_the_slope_of_the_heat_and_runs_away_at_its_limit():
    limit = G / ALPHA
    for watts, wanted in ((3.0, 20.0 + 3.0 / (G - ALPHA * 3.0)), (1.001 * limit, np.nan)):
        assert settled(NODE, 20.0, np.array([watts])) == pytest.approx(wanted, nan_ok=True)
    assert np.isfinite(settled(NODE, 20.0, np.array([0.999 * limit])))
    assert [largest_factor(NODE, np.array([watts])) for watts in (1.0, 0.0)] == pytest.approx([limit, math.inf])


@pytest.mark.parametrize("power", [3.0, 2.0 * G / ALPHA], ids=["settles", "runs away"])
def test_one_node_warms_up_along_an_exponential_that_its_own_heat_turns(power):
    rate = (ALPHA * power - G) / C
    exact = math.log1p(20.0 * rate * C / power) / rate  # T - 20 = P / (alpha P - G) (exp(rate t) - 1)
    found = time_until(NODE, 20.0, lambda now: power * (1.0 + ALPHA * (now - 20.0)), lambda now: now[0] - 40.0)
    assert found == pytest.approx(exact, rel=1e-5)


INNER, OUTER, HEIGHT, K = 0.006, 0.011, 0.03, 0.3


def coil(**changes):
    corners = ((INNER, 0.0), (OUTER, 0.0), (OUTER, HEIGHT), (INNER, HEIGHT))
    return Coil(**{"vertices_m": corners, "turns": 200.0, "resistance_ohm": 1.0, "wire_diameter_m": 4e-4} | changes)


def shell(inner_C, outer_C, watts):
    """Mean of T(r) = A + B ln r - q r^2 / (4 k) in a shell, and the heat through its outer face."""
    q = watts / (math.pi * (OUTER**2 - INNER**2) * HEIGHT)
    slope = (outer_C - inner_C + q * (OUTER**2 - INNER**2) / (4.0 * K)) / math.log(OUTER / INNER)

    def temperature(r):
        return inner_C + slope * math.log(r / INNER) - q * (r**2 - INNER**2) / (4.0 * K)

    mean = quad(lambda r: temperature(r) * r, INNER, OUTER)[0] / (0.5 * (OUTER**2 - INNER**2))
    return mean, -2.0 * math.pi * HEIGHT * K * (slope - q * OUTER**2 / (2.0 * K))


@pytest.mark.parametrize(("inner", "outer"), [(20.0, 20.0), (50.0, 20.0), (20.0, 70.0)])
def test_the_radial_star_has_the_mean_and_the_flow_of_a_heated_shell(inner, outer):
    watts, (to_inner, to_outer, to_mean) = 5.0, stars(coil(), K)[0]
    mean, flow = shell(inner, outer, watts)
    centre = (inner / to_inner + outer / to_outer + watts) / (1.0 / to_inner + 1.0 / to_outer)
    assert centre + watts * to_mean == pytest.approx(mean, abs=1e-9)
    assert (centre - outer) / to_outer == pytest.approx(flow, abs=1e-9)


def test_a_varnished_winding_conducts_as_it_was_measured():
    """A. A. Wereszczak and others, J. Thermal Science and Engineering Applications: 0.5 to 1 W/(m K) at 50 % copper."""
    area = (OUTER - INNER) * HEIGHT
    half = coil(turns=0.5 * area / (0.25 * math.pi * 7e-4**2), wire_diameter_m=7e-4)
    assert 0.5 < winding_heat(half, 0.25).conductivity_W_per_m_K < 1.0


def test_an_unknown_wire_follows_from_the_resistance_which_holds_at_the_drawings_temperature():
    given = 200 * 2 * math.pi * 0.0085 * 1.7241e-8 / (0.25 * math.pi * 4e-4**2)
    known, unknown = (winding_heat(coil(resistance_ohm=given, **wire), 0.1) for wire in ({}, {"wire_diameter_m": None}))
    assert unknown.conductivity_W_per_m_K == pytest.approx(known.conductivity_W_per_m_K)
    densest, denser = (winding_heat(coil(resistance_ohm=r, wire_diameter_m=None), 0.1) for r in (1e-4, 1e-5))
    assert densest.conductivity_W_per_m_K == denser.conductivity_W_per_m_K > known.conductivity_W_per_m_K
    for warm_C, ohm in ((100.0, 1.0 / (1.0 + 0.00393 * 80.0)), (20.0, 1.0)):
        assert winding_heat(coil(temperature_C=warm_C), 0.1).cold_ohm == pytest.approx(ohm)


def test_a_cylindrical_gap_conducts_as_its_closed_form():
    faces = faces_of([shapely.box(0.0, 0.0, 0.005, 0.02), shapely.box(0.007, 0.0, 0.009, 0.02)], 0.003)
    for one, other in ((0, 1), (1, 0)):
        met = (faces.owner == one) & (faces.facing == other)
        found = np.sum(faces.area[met] / faces.gap[met])
        assert found == pytest.approx(2.0 * np.pi * 0.02 / np.log(7.0 / 5.0), rel=1e-6)


@pytest.mark.parametrize(("mouth", "found"), [(0.002, NOTHING), (0.006, OPEN)])
def test_a_pocket_is_open_where_a_disc_as_wide_as_the_widest_gap_gets_in(mouth, found):
    """A ring-shaped pocket of 10 mm by 10 mm in a block, with a slit to the outside."""
    block = shapely.box(0.005, 0.0, 0.03, 0.02) - shapely.box(0.01, 0.005, 0.02, 0.015)
    block -= shapely.box(0.02, 0.01 - 0.5 * mouth, 0.03, 0.01 + 0.5 * mouth)
    faces = faces_of([block], 0.005)
    inner = 2.0 * np.pi * 0.01 * 0.01  # the pocket's wall next to the axis
    outer = 2.0 * np.pi * (0.03**2 - 0.005**2 + 0.03 * (0.02 - mouth) + 0.005 * 0.02)
    free = faces.area[faces.facing == OPEN].sum()
    assert (free > outer + 0.9 * inner) == (found == OPEN)
    if found == NOTHING:
        seen = 2.0 * np.pi * 0.01 * mouth  # of the pocket's wall, which looks out through the slit
        assert free == pytest.approx(outer + seen, rel=2e-3)
