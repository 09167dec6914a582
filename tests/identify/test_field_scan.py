"""A probe scan is compared with the solved field, and what is simple about its error is said."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from femfit.core.errors import DomainError, TableError
from femfit.device.load import read_actuator
from femfit.field.problem import axial_field
from femfit.identify.field_scan import compare_field_scan
from femfit.tables.measurement import FieldScan
from femfit.tables.measurement_file import read_field_scan
from support.actuators import swept_at
from support.command import femfit

DRAWING = Path(__file__).parents[2] / "geometry" / "magnet-pair.toml"
NOISE_T = 2e-4


@pytest.fixture(scope="module")
def actuator():
    return read_actuator(DRAWING)


@pytest.fixture(scope="module")
def scan(actuator):
    """Readings between the magnets of a probe that is right."""
    r, z = (one.ravel() for one in np.meshgrid([-8e-3, 0.0, 6e-3, 12e-3], np.linspace(3e-3, 17e-3, 8)))
    distance, current = np.full(len(r), 20e-3), np.zeros(len(r))
    field = axial_field(actuator, distance, current)(r, z)
    return FieldScan(distance, current, r, z, field + NOISE_T * np.random.default_rng(2).standard_normal(len(r)))


def test_the_field_on_the_axis_of_a_magnet_is_that_of_its_closed_form(actuator):
    """One magnet of 45 mm x 30 mm, the other too far away to count; recoil permeability 1.05 takes a little."""
    distance, z = 0.2, np.array([5e-3, 15e-3])
    material = actuator.fixed[0].material
    ends = [(z + offset) / np.hypot(z + offset, 22.5e-3) for offset in (30e-3, 0.0)]
    exact = 0.5 * material.remanence_T * (ends[0] - ends[1])
    wide = swept_at(actuator, (0.1, distance))
    solved = axial_field(wide, np.full(2, distance), np.zeros(2))(np.zeros(2), z)
    assert solved == pytest.approx(exact, rel=0.03)


def test_a_right_probe_leaves_its_noise(actuator, scan):
    found = compare_field_scan(actuator, scan)
    assert found.rms_T == pytest.approx(NOISE_T, rel=0.4)


def test_a_gain_an_offset_and_another_place_are_told_apart(actuator, scan):
    seen = replace(scan, height=scan.height - 0.2e-3, field=0.97 * scan.field + 2e-3)
    found = compare_field_scan(actuator, seen)
    assert found.explained["gain"][0] == pytest.approx(-0.03, abs=0.005)
    assert found.explained["offset_T"][0] == pytest.approx(2e-3, rel=0.25)
    assert found.explained["higher_m"][0] == pytest.approx(0.2e-3, rel=0.15)
    assert found.left_T < 2.0 * NOISE_T


@pytest.mark.parametrize("seed", [3, *(pytest.param(k, marks=pytest.mark.nightly) for k in (4, 5))])
def test_a_probe_that_stands_far_beside_its_place_is_found_with_its_gain(actuator, tmp_path, seed):
    """Of 4.7 mm the slopes at the recorded places are wrong by far more than the noise of the readings."""
    z = np.linspace(2e-3, 12e-3, 30)
    distance, current = np.full(len(z), 20e-3), np.zeros(len(z))
    field = 1.07 * axial_field(actuator, distance, current)(np.zeros(len(z)), z + 4.7e-3)
    field += NOISE_T * np.random.default_rng(seed).standard_normal(len(z))
    rows = [f"20,0,{1e3 * height:.6g},{1e3 * reading:.9g}" for height, reading in zip(z, field, strict=True)]
    (tmp_path / "scan.csv").write_text("\n".join(["distance_mm,r_mm,z_mm,Bz [mT]", *rows]) + "\n", encoding="utf-8")
    done = femfit("compare", DRAWING, tmp_path / "scan.csv", "--json", tmp_path / "found.json")
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "found.json").read_text(encoding="utf-8"))
    for name, true in (("gain", 0.07), ("higher_m", 4.7e-3)):
        value, error = found["explained"][name]
        assert abs(value - true) < 3.0 * error
    assert found["left_T"] == pytest.approx(NOISE_T, rel=0.4)


@pytest.mark.parametrize(("top", "end"), [(0.0205, "edge"), (1.0, "settled")])
def test_a_fit_that_leads_out_of_the_solved_field_explains_nothing(actuator, monkeypatch, top, end):
    """A probe that stands 1.5 mm higher than recorded, where the solved field ends 0.5 mm above the highest place."""

    def on_axis(z):
        return 0.5 / (1.0 + (z / 5e-3) ** 2)

    def solved(radius, height):
        if np.any(height > top):
            raise DomainError("outside")
        return on_axis(height)

    monkeypatch.setattr("femfit.identify.field_scan.axial_field", lambda *_: solved)
    z, zero = np.linspace(5e-3, 20e-3, 16), np.zeros(16)
    field = on_axis(z + 1.5e-3) + 1e-5 * np.random.default_rng(0).standard_normal(16)
    found = compare_field_scan(actuator, FieldScan(zero + 20e-3, zero, zero, z, field))
    assert found.fit_end == found.to_dict()["fit_end"] == end
    if end == "edge":
        assert found.explained == {}
        assert found.left_T == found.rms_T
    else:
        value, error = found.explained["higher_m"]
        assert abs(value - 1.5e-3) < 3.0 * error


def test_a_place_outside_of_the_domain_and_a_current_without_a_circuit_are_refused(actuator, scan):
    with pytest.raises(DomainError, match="domain"):
        compare_field_scan(actuator, replace(scan, height=1e3 * scan.height))
    with pytest.raises(TableError, match="0 circuits"):
        compare_field_scan(actuator, replace(scan, current=scan.current + 1.0))


def test_places_beside_a_distance_are_read_in_their_units(tmp_path):
    path = tmp_path / "scan.csv"
    path.write_text("distance_mm,r_mm,z_mm,Bz [mT]\n20,0,5,820\n20,3,,810\n", encoding="utf-8")
    scan = read_field_scan(path)
    assert (scan.distance.tolist(), scan.radius.tolist(), scan.height.tolist()) == ([0.02], [0.0], [0.005])
    assert scan.field == pytest.approx([0.82])
    assert scan.current.tolist() == [0.0]


def test_a_scan_without_a_place_is_refused(tmp_path):
    path = tmp_path / "scan.csv"
    path.write_text("distance_mm,field_mT\n20,820\n", encoding="utf-8")
    with pytest.raises(TableError, match="r_m, z_m"):
        read_field_scan(path)
