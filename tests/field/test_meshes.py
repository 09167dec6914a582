"""Meshes: the layer round the moving part is as wide as there is room, and skin layers fit together."""

import dataclasses
import math
from collections import Counter
from dataclasses import replace

import ngsolve as ng
import numpy as np
import pytest
import shapely
from ngsolve import CF, Integrate

from femfit.core.errors import FieldSolverError
from femfit.device.load import actuator_from_toml, read_actuator
from femfit.device.outlines import circle
from femfit.device.parts import LinearMaterial, NonlinearMaterial, Region
from femfit.field.drawing import build_mesh, layer_outlines
from femfit.field.layout import layout_of, layout_of_group, mover_outline, stretch_groups
from femfit.field.moving_mesh import MovingMesh
from femfit.field.tolerance import SolverSettings, settings_for
from support import eddy_cases as cases
from support.actuators import GEOMETRY, millimetres, swept_at
from support.eddy_cases import COPPER, STEEL
from support.field import prepared
from support.small_drawing import POT

SETTINGS = SolverSettings(order=4)
NARROW, FAR = 1e-4, 8e-3


def swept_over(distances):
    actuator = read_actuator(GEOMETRY / "biased-electromagnet.toml")
    return replace(actuator, sensors=(), sweep=replace(actuator.sweep, distances_m=tuple(distances)))


def test_a_narrow_gap_costs_nothing_where_the_gap_is_wide():
    actuator = swept_over([NARROW, FAR])
    alone, thin = (
        build_mesh(actuator, FAR, layout_of(one, SETTINGS), SETTINGS) for one in (swept_over([FAR]), actuator)
    )
    assert prepared(actuator, FAR, SETTINGS).mesh.ne == alone.ne < 0.7 * thin.ne


@pytest.mark.parametrize("distances", [(NARROW,), (NARROW, 1.1 * NARROW, 1.2 * NARROW)])
def test_a_narrow_gap_makes_the_layer_thin_at_the_gap_alone(distances):
    actuator = swept_over(distances)
    layout = layout_of_group(actuator, distances, layout_of(actuator, SETTINGS), SETTINGS)
    mover = mover_outline(actuator)
    inner, outer = layer_outlines(actuator, layout)
    core = shapely.union_all([shapely.Polygon(region.vertices_m) for region in actuator.fixed])
    assert outer.contains(inner)
    assert inner.contains_properly(shapely.LineString([p for p in mover.exterior.coords if p[0] > 0.0]))
    assert shapely.affinity.translate(outer, 0.0, NARROW).distance(core) > 0.2 * NARROW
    assert mover.bounds[1] - outer.bounds[1] < NARROW
    assert outer.bounds[3] - mover.bounds[3] > 20.0 * NARROW


def test_the_width_of_the_layer_does_not_matter_to_the_force():
    moderate = swept_over([2e-3, FAR])
    near, alone = (prepared(a, FAR, SETTINGS).rows(FAR, a.sweep.currents_A) for a in (moderate, swept_over([FAR])))
    np.testing.assert_allclose(near["force_N"], alone["force_N"], rtol=1e-9)  # the same mesh, solved twice
    finer = prepared(swept_over([FAR]), FAR, SolverSettings(order=6, corner_fraction=0.03))
    reference = finer.rows(FAR, moderate.sweep.currents_A)
    off = np.abs(np.subtract(near["force_N"], reference["force_N"]))
    assert np.all(off <= np.array(near["force_error_N"]))  # the estimate covers the error


PLUNGER = read_actuator(GEOMETRY / "plunger-solenoid.toml")
THIN = replace(PLUNGER.moving.regions[0], vertices_m=((0.0, 0.0), (2e-3, 0.0), (2e-3, 0.035), (0.0, 0.035)))
WIDE_BORE = replace(PLUNGER, moving=replace(PLUNGER.moving, regions=(THIN,)))


@pytest.mark.parametrize("count", [12, 40])
@pytest.mark.parametrize(
    ("actuator", "ends"), [(swept_over([NARROW]), (NARROW, FAR)), (PLUNGER, (5e-4, 0.012)), (WIDE_BORE, (NARROW, 4e-3))]
)
def test_no_group_is_stretched_beyond_the_limit(actuator, ends, count):
    layout = layout_of(swept_at(actuator, tuple(np.geomspace(*ends, count))), SETTINGS)
    groups = stretch_groups(tuple(np.geomspace(*ends, count)), layout, SETTINGS)
    assert len(groups) <= 12
    for group in groups:
        own = layout_of_group(actuator, group, layout, SETTINGS)
        near, far = (own.gaps(distance) for distance in (group[0], group[-1]))
        assert np.all(np.concatenate([near, far]) > 0.0)
        assert np.all(np.maximum(far / near, near / far) <= SETTINGS.stretch_limit * (1.0 + 1e-9))
        assert own.outer_offset >= layout.outer_offset


def test_bodies_share_a_mesh_where_vertical_edges_alone_pass_each_other():
    def meshes(actuator):
        distances = tuple(np.linspace(3e-3, 4e-3, 5))
        return len(stretch_groups(distances, layout_of(swept_at(actuator, distances), SETTINGS), SETTINGS))

    (plunger,) = PLUNGER.moving.regions
    (r0, z0), (r1, z1) = np.min(plunger.vertices_m, axis=0), np.max(plunger.vertices_m, axis=0)
    middle = 0.5 * (z0 + z1)
    cone = ((r0, z0), (0.8 * r1, z0), (r1, middle), (r1, z1), (r0, z1))  # its edge passes the bore
    tapered = replace(PLUNGER.moving, regions=(replace(plunger, vertices_m=cone),))
    assert meshes(PLUNGER) == 1
    assert meshes(replace(PLUNGER, moving=tapered)) == 5


def test_no_edge_of_the_layer_is_too_short_to_be_meshed():
    # Two steps of the layer round this plunger met within 0.1 um at 1.0999087 mm, and the solver could not draw that.
    actuator, layout = PLUNGER, layout_of(PLUNGER, SETTINGS)
    for distance in (1.0999086569638599e-3, *np.linspace(0.5e-3, 9e-3, 41)):
        own = layout_of_group(actuator, (float(distance),), layout, SETTINGS)
        for outline in layer_outlines(actuator, own):
            edges = np.hypot(*np.diff(np.array(outline.exterior.coords), axis=0).T)
            assert edges.min() > 0.02 * own.inner_offset, distance


def test_a_stepped_body_is_meshed_once_everywhere_and_a_mesh_that_covers_a_region_twice_is_refused(monkeypatch):
    actuator = actuator_from_toml(POT)
    settings = settings_for(actuator)
    moving = MovingMesh(actuator, (0.0015,), layout_of(actuator, settings), settings)
    layer = Integrate(CF(1.0), moving.mesh, definedon=moving.mesh.Materials("layer"))
    outer, inner = layer_outlines(actuator, moving.layout)[::-1]
    assert layer == pytest.approx(outer.area - inner.area, rel=1e-9)  # it was covered twice
    monkeypatch.setattr("femfit.field.drawing.without_spikes", lambda outline: outline)
    with pytest.raises(FieldSolverError, match=r"2\.0\d times"):
        MovingMesh(actuator, (0.0015,), layout_of(actuator, settings), settings)


DRAWINGS = sorted(GEOMETRY.glob("*.toml"))
LARGE = {"bearing.toml", "magnet-pair.toml"}
"""Their thin layers alone make 35,000 unknowns."""


def conducting(actuator):
    """The same with a conductivity of its own kind for all that has none, linear."""

    def material(one):
        if isinstance(one, NonlinearMaterial):
            one = LinearMaterial(one.name, min(one.relative_permeability, 1000.0))
        usual = 7e5 if one.remanence_T else 5e6 if one.relative_permeability > 2.0 else 58e6
        return one if one.conductivity_S_per_m else dataclasses.replace(one, conductivity_S_per_m=usual)

    def regions(group):
        return tuple(dataclasses.replace(one, material=material(one.material)) for one in group)

    moving = dataclasses.replace(actuator.moving, regions=regions(actuator.moving.regions))
    return dataclasses.replace(actuator, fixed=regions(actuator.fixed), moving=moving)


def loose_edges(mesh, radius):
    """Edges within the mesh that are not of two elements, or on its boundary not of one."""
    found = Counter(edge.nr for element in mesh.Elements(ng.VOL) for edge in element.edges)
    loose = []
    for edge, elements in found.items():
        ends = np.array([mesh[vertex].point for vertex in mesh[ng.NodeId(ng.EDGE, edge)].vertices])
        boundary = np.all(ends[:, 0] < 1e-12) or np.allclose(np.hypot(*ends.T), radius, rtol=1e-9)
        if elements != (1 if boundary else 2):
            loose.append((ends.tolist(), elements))
    return loose


def smallest_determinant(mesh):
    """Of the elements' maps, over its mean in the element."""
    jacobian = ng.specialcf.JacobianMatrix(2)
    determinant = jacobian[0, 0] * jacobian[1, 1] - jacobian[0, 1] * jacobian[1, 0]
    steps = [(k / 6.0, j / 6.0) for k in range(7) for j in range(7)]
    rules = {ng.ET.QUAD: steps, ng.ET.TRIG: [(a, b) for a, b in steps if a + b < 1.0 + 1e-9]}
    smallest = math.inf
    for shape, points in rules.items():
        if any(element.type == shape for element in mesh.Elements(ng.VOL)):
            rule = {one: ng.IntegrationRule([], []) for one in rules}
            rule[shape] = ng.IntegrationRule(points, [1.0] * len(points))
            values = determinant(mesh.MapToAllElements(rule, ng.VOL)).reshape(-1, len(points))
            smallest = min(smallest, float((values / np.abs(values.mean(axis=1, keepdims=True))).min()))
    return smallest


def check(moving):
    assert loose_edges(moving.mesh, moving.layout.outer_radius) == []
    assert smallest_determinant(moving.mesh) > 0.1


@pytest.mark.parametrize("frequency", [1e5, *(pytest.param(f, marks=pytest.mark.nightly) for f in (10.0, 1e3))])
@pytest.mark.parametrize("path", [one for one in DRAWINGS if one.name not in LARGE], ids=lambda one: one.stem)
def test_mesh_of_every_drawing_fits_together(path, frequency):
    actuator, settings = conducting(read_actuator(path)), SolverSettings(order=4, skin_frequency_Hz=frequency)
    layout = layout_of(actuator, settings)
    for group in stretch_groups(actuator.sweep.distances_m, layout, settings)[:1]:
        moving = MovingMesh(actuator, group, layout, settings)
        check(moving)
        for distance in (group[0], group[-1]):
            with moving.at(distance):
                assert smallest_determinant(moving.mesh) > 0.1


def part(name, body, *corners):
    outline = millimetres(*corners) if len(corners) == 4 else tuple((1e-3 * r, 1e-3 * z) for r, z in corners)
    return Region(name, outline, cases.material(body, name=f"of {name}"))


def disc(name, body, r, z, radius):
    corners, bulges = circle((1e-3 * r, 1e-3 * z), 1e-3 * radius)
    return Region(name, tuple(corners), cases.material(body, name=f"of {name}"), tuple(bulges))


POT_CORNERS = ((0, -9), (18, -9), (18, 9), (14, 9), (14, -5), (10, -5), (10, 9), (0, 9))

NEIGHBOURS = {
    "on the axis": [part("core", STEEL, 0, 8, -5, 5)],
    "two share an edge": [part("inner", COPPER, 0, 4, -5, 5), part("outer", STEEL, 4, 8, -5, 5)],
    "two share a part of an edge": [part("inner", COPPER, 0, 4, -5, 5), part("outer", STEEL, 4, 8, -2, 9)],
    "two touch at a corner": [part("low", COPPER, 0, 4, -5, 0), part("high", STEEL, 4, 8, 0, 5)],
    "round the coil": [part("pot", STEEL, *POT_CORNERS)],
    "a ball": [disc("ball", STEEL, 0, 0, 8)],
    "a round ring": [disc("ring", COPPER, 20, 0, 4)],
    "a cone": [part("cone", STEEL, (0, -5), (8, -5), (0, 6))],
    "a needle": [part("needle", STEEL, (0, -5), (1, -5), (0, 20))],
    "a wedge of 5 degrees": [part("wedge", COPPER, (2, 0), (9, -0.4), (9, 0.4))],
    "a tube of 0.1 mm on the coil": [part("tube", COPPER, 9.9, 10, -5, 5)],
    "a coating of 0.05 mm": [part("core", STEEL, 0, 8, -25, 5), part("coating", COPPER, 8, 8.05, -25, 5)],
    "a slit of 0.01 mm": [part("low", STEEL, 0, 8, -5, -0.01), part("high", STEEL, 0, 8, 0, 5)],
    "a small one beside a large one": [part("large", STEEL, 0, 100, -60, -6), part("small", COPPER, 0, 0.5, -5, -4.5)],
}


@pytest.mark.parametrize("frequency", [1e5, pytest.param(50.0, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("name", NEIGHBOURS)
def test_conductors_that_touch_are_meshed_and_solved(name, frequency):
    harmonic = cases.Harmonic(cases.drawing(NEIGHBOURS[name], [(0.01, 0.014, -0.005, 0.005)]), frequency, order=4)
    check(harmonic.moving)
    s = 2j * math.pi * frequency
    found, fields = harmonic.solve(s)
    assert (s * found[0, 0]).real == pytest.approx(cases.loss(harmonic, s, fields[0]), rel=1e-5)


def test_sheets_and_parts_that_do_not_conduct_get_no_layers():
    plain, sheets, air = (
        cases.Harmonic(cases.core(body, thickness), 1e5, order=4).moving.mesh.ne
        for body, thickness in ((STEEL, 0.0), (STEEL, 1e-4), ((0.0, 100.0), 0.0))
    )
    assert plain > sheets == air
