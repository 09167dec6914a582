"""FEMM drawings, those of ``fem/`` with edits, and the actuator that each becomes or why it is refused; in mm.

``fem/NAME.expected.json`` holds the cases of ``fem/NAME.fem``: ``edits`` of its text or ``lines`` in its place, and
the ``options`` of the import. What comes out: the parts of the actuator, its axes, the codes of the findings with their
sizes, or the class of the error; ``mentions`` are the facts that its message names.
"""

import tomllib
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from femfit.core.errors import FemfitError
from femfit.device.load import actuator_from_toml
from femfit.device.outlines import flattened
from femfit.tables.femm.model import FemOptions
from femfit.tables.femm.read import import_fem
from support.expected import cases, rounded, unmentioned
from support.fem_files import UNIT_MM, suspension

DRAWINGS = Path(__file__).parent / "fem"


def outline(part, bulges=()):
    """Area (mm2) and box (r from, to, z from, to, in mm) of a part, rounded to the nanometre that outlines keep."""
    polygon = shapely.Polygon(flattened(part.vertices_m, bulges or tuple(0.0 for _ in part.vertices_m)))
    r0, z0, r1, z1 = (round(1e3 * x, 5) for x in polygon.bounds)
    return {"area_mm2": round(1e6 * polygon.area, 3), "corners": len(part.vertices_m), "box_mm": [r0, r1, z0, z1]}


def material(of):
    keys = ("name", "relative_permeability", "remanence_T", "direction", "flux_density_T", "field_A_per_m")
    return {key: value for key in keys if (value := getattr(of, key, None))}


def facts(result):
    """What a drawing became, for JSON."""
    actuator = result.actuator
    parts = {"fixed": actuator.fixed, "moving": actuator.moving.regions}
    regions = {
        place: [{"name": x.name, **outline(x, x.bulges), "material": material(x.material)} for x in every]
        for place, every in parts.items()
    }
    keys = ("turns", "sign", "moves", "circuit", "resistance_ohm", "wire_diameter_m")
    coils = [{"name": x.name, **outline(x), **{key: getattr(x, key) for key in keys}} for x in actuator.coils]
    sweep = {"currents_A": [actuator.sweep.currents_A, *actuator.sweep.further_A]}
    sweep["distances_mm"] = [1e3 * x for x in actuator.sweep.distances_m]
    tables = tomllib.loads(result.toml)
    return {
        "name": actuator.name,
        "schema": tables["schema"],
        "at": {"currents_A": result.currents_A, "distance_mm": 1e3 * result.distance_m},
        "frame": {key: getattr(result.frame, key) for key in ("face_mm", "up", "field_sign")},
        **regions,
        "coils": coils,
        "mass_g": 1e3 * actuator.mechanics.mass_kg,
        "sweep": sweep,
        "supply": "supply" in tables,
        "findings": {one.code: one.size for one in sorted(result.findings, key=lambda one: one.code)},
    }


@pytest.mark.parametrize(("path", "name"), cases(DRAWINGS))
def test_a_drawing_becomes_the_actuator_that_is_expected(path, name, expected):
    case = expected.read(path)[name]
    content = path.with_name(path.name.replace(".expected.json", ".fem")).read_text(encoding="utf-8")
    content = "\n".join(case["lines"]) if "lines" in case else content
    for old, new in case.get("edits", {}).items():
        assert content.count(old) == 1, old
        content = content.replace(old, new)
    options = {key: tuple(x) if isinstance(x, list) else x for key, x in case.get("options", {}).items()}
    try:
        imported = import_fem(content.encode(), "model.fem", FemOptions(**options))
    except FemfitError as error:
        result, text = {"error": type(error).__name__, "problems": len(error.problems)}, str(error)
    else:
        assert actuator_from_toml(imported.toml) == imported.actuator
        result, text = rounded(facts(imported)), imported.toml + "\n".join(map(str, imported.findings))
    assert not unmentioned(case.get("mentions", ()), text), text
    expected.case(path, name, ("edits", "lines", "options", "mentions"), result)


def imported(text):
    return import_fem(text.encode(), "model.fem", FemOptions()).actuator


def parts(actuator):
    return (*actuator.fixed, *actuator.moving.regions, *actuator.coils)


@settings(max_examples=15, deadline=None)
@given(unit=st.sampled_from(sorted(UNIT_MM)), below=st.booleans(), face=st.sampled_from([0.0, -37.25, 12.5]))
def test_a_drawing_in_other_units_upside_down_or_shifted_is_the_same_actuator(unit, below, face):
    expected, actuator = imported(suspension()), imported(suspension(unit, below=below, face=face))
    assert actuator.sweep == expected.sweep
    for part, same in zip(parts(actuator), parts(expected), strict=True):
        np.testing.assert_allclose(sorted(part.vertices_m), sorted(same.vertices_m), atol=1e-9)
        # a mirror at a plane z = const leaves axial moments and currents as they are
        assert getattr(part, "material", None) == getattr(same, "material", None)
