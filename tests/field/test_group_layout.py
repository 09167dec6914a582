"""The layer round the moving part is as wide as its group of distances has room for."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from ngsolve import CF, Integrate

from femfit.core.errors import FieldSolverError
from femfit.device.load import actuator_from_toml, read_actuator
from femfit.field.drawing import build_mesh, layer_outlines
from femfit.field.layout import (
    layout_of,
    layout_of_group,
    mover_outline,
    stretch_groups,
)
from femfit.field.moving_mesh import MovingMesh
from femfit.field.tolerance import SolverSettings, settings_for
from support.actuators import swept_at
from support.field import prepared
from support.small_drawing import POT

SETTINGS = SolverSettings(order=4)
NARROW, FAR = 1e-4, 8e-3


def swept_over(distances):
    actuator = read_actuator(Path(__file__).parents[2] / "geometry" / "biased-electromagnet.toml")
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


PLUNGER = read_actuator(Path(__file__).parents[2] / "geometry" / "plunger-solenoid.toml")
THIN = replace(PLUNGER.moving.regions[0], vertices_m=((0.0, 0.0), (2e-3, 0.0), (2e-3, 0.035), (0.0, 0.035)))
WIDE_BORE = replace(PLUNGER, moving=replace(PLUNGER.moving, regions=(THIN,)))


@pytest.mark.parametrize("count", [12, 40])
@pytest.mark.parametrize(
    ("actuator", "ends"),
    [(swept_over([NARROW]), (NARROW, FAR)), (PLUNGER, (5e-4, 0.012)), (WIDE_BORE, (NARROW, 4e-3))],
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
