"""What a valid file becomes: SI values exact to the last digit, resistance by hand, the three files of geometry/."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import shapely

from femfit.device.electrics import HallElement, where_clipped
from femfit.device.keys import scaled
from femfit.device.load import read_actuator, starter_text, sweep_manifest_entry
from femfit.device.parts import smallest_winding_area, wire_resistance
from support.actuators import GEOMETRY


def test_the_rig_and_the_printed_suspension_differ_only_in_their_coil_and_have_the_core_of_table_1():
    printed, rig = (read_actuator(GEOMETRY / f"{name}.toml") for name in ("emaws", "emaws-rig"))
    for part in ("fixed", "moving", "supplies_V", "sample_time_s", "sweep", "hall"):
        assert getattr(printed, part) == getattr(rig, part)
    assert (printed.coil.turns, rig.coil.turns) == (30, 308)
    # eq. (32): R / L = 165.6 1/s and 1 / L = 61.61 1/H, R to the three digits the file gives
    assert rig.coil.resistance_ohm == pytest.approx(165.6 / 61.61, abs=0.005)
    outlines = [shapely.Polygon(region.vertices_m) for region in rig.fixed]
    volume = sum(2 * math.pi * outline.area * outline.centroid.x for outline in outlines)
    by_hand = math.pi * (2 * 0.005 * (0.02**2 - 0.0025**2) + 0.015 * (0.01**2 - 0.0025**2))
    assert volume == pytest.approx(by_hand, rel=1e-12)


def test_resistances_and_masses_of_the_plunger_and_of_copper_are_those_by_hand():
    actuator = read_actuator(GEOMETRY / "plunger-solenoid.toml")
    # steel at 7.85 g/cm3; the file gives three digits
    assert actuator.mechanics.mass_kg == pytest.approx(7850 * math.pi * 0.005**2 * 0.035, rel=2e-3)
    # mean radius 9.5 mm: 560 turns are 33.427 m of 0.15904 mm^2
    assert actuator.coil.resistance_ohm == pytest.approx(33.427 * 0.017241 / 0.15904, rel=1e-4)
    # By hand: 308 turns of 2 pi 15 mm are 29.028 m; 0.18857 mm^2 of copper at 0.017241 ohm mm^2/m.
    cold = wire_resistance(308, 0.015, 0.49e-3)
    assert cold == pytest.approx(29.028 * 0.017241 / 0.18857, rel=1e-4)
    assert wire_resistance(308, 0.015, 0.49e-3, 120.0) / cold == pytest.approx(1.393, rel=1e-12)
    # n x n wires of diameter d fill (n d)^2 in a square grid, so the bound must not exceed it.
    assert smallest_winding_area(100, 0.5) <= (10 * 0.5) ** 2
    assert smallest_winding_area(100, 0.5) == pytest.approx(100 * math.pi / 4 * 0.25 / 0.9069, rel=1e-4)


def test_millimetres_become_the_nearest_double_of_the_metres():
    assert [scaled(v) for v in (0.1, 0.3, 15.5, 20, 1e-5)] == [0.0001, 0.0003, 0.0155, 0.02, 1e-8]


def test_two_coils_in_series_are_one_circuit_of_the_manifest(tmp_path):
    head, tail = starter_text("bearing").split("[sweep]")
    circuit = '[circuits.pair]\ncoils = ["lower", "-upper"]\nexternal_resistance_ohm = 1\n\n[sweep]'
    (tmp_path / "pair.toml").write_text(head + circuit + re.sub(r"current_A = .*", "current_A = [-2, 0, 2]", tail))
    actuator = read_actuator(tmp_path / "pair.toml")
    entry = sweep_manifest_entry(actuator)
    assert entry["resistance_ohm"] == pytest.approx(1.0 + sum(coil.resistance_ohm for coil in actuator.coils))
    assert (entry["voltage_min_V"], entry["voltage_max_V"]) == (-24.0, 24.0)
    assert "turns" not in entry


@pytest.mark.parametrize(
    ("sensitivity", "factor", "clause"),
    [
        (50.0, 1.0, "clipped at 5 V from 1.00 to 4.00 mm at some currents"),
        (50.0, -1.0, "clipped at 0 V from 1.00 to 4.00 mm at some currents"),
        (5.0, 1.0, ""),
        (50.0, np.nan, ""),  # points that failed are not clipped
    ],
)
def test_clipping_is_said_with_its_distances(sensitivity, factor, clause):
    """50 V/T about 2.5 V between 0 and 5 V: beyond 50 mT. The magnet's 60 mT at 1 mm fall by 10 mT a millimetre."""
    distance, current = (x.ravel() for x in np.meshgrid(1e-3 * np.arange(1, 11), [0.0, 0.5, 1.0]))
    field = 0.07 - 10.0 * distance + 0.02 * current
    hall = replace(HallElement(0.0, 0.0), sensitivity_V_per_T=sensitivity)
    assert where_clipped(hall, distance, factor * field) == clause
