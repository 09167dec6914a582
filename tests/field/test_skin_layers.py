"""The mesh with skin layers fits together, whatever is drawn, and no element of it is turned over."""

import dataclasses
import math
from collections import Counter

import ngsolve as ng
import numpy as np
import pytest

from femfit.device.load import read_actuator
from femfit.device.outlines import circle
from femfit.device.parts import LinearMaterial, NonlinearMaterial, Region
from femfit.field.layout import layout_of, stretch_groups
from femfit.field.moving_mesh import MovingMesh
from femfit.field.tolerance import SolverSettings
from support import eddy_cases as cases
from support.actuators import GEOMETRY, millimetres
from support.eddy_cases import COPPER, STEEL

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


POT = ((0, -9), (18, -9), (18, 9), (14, 9), (14, -5), (10, -5), (10, 9), (0, 9))

NEIGHBOURS = {
    "on the axis": [part("core", STEEL, 0, 8, -5, 5)],
    "two share an edge": [part("inner", COPPER, 0, 4, -5, 5), part("outer", STEEL, 4, 8, -5, 5)],
    "two share a part of an edge": [part("inner", COPPER, 0, 4, -5, 5), part("outer", STEEL, 4, 8, -2, 9)],
    "two touch at a corner": [part("low", COPPER, 0, 4, -5, 0), part("high", STEEL, 4, 8, 0, 5)],
    "round the coil": [part("pot", STEEL, *POT)],
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
