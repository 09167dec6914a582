"""FEMM models of every layout on one axis: windings, movers, boundaries and magnets as people draw them. In mm."""

import math
import re
import shlex
import tomllib

import pytest

from femfit.core.constants import MU_0
from femfit.core.errors import FemFileError
from femfit.device.load import actuator_from_toml
from femfit.field.sweep import run_sweep
from femfit.tables.femm.options import FemOptions, axis_option
from femfit.tables.femm.read import import_fem
from support.fem_files import AIR, COPPER, MAGNET, STEEL, FemDrawing, suspension


def imported(drawing, **options):
    return import_fem(drawing.content(), "model.fem", FemOptions(**options))


def codes(result):
    return {finding.code for finding in result.findings}


def said(result, code):
    (finding,) = [finding for finding in result.findings if finding.code == code]
    return finding


def tables(result):
    return tomllib.loads(result.toml)


def surrounded(drawing, radius=120.0):
    """Air out to a half circle."""
    drawing.line((0, -radius), (0, radius))
    drawing.arc((0, -radius), (0, radius), 180, 1)
    drawing.label(radius / 2, radius / 2, AIR)
    return drawing


def voice_coil():
    """A coil in the ring gap of a pot with a magnet: everything in mm."""
    drawing = FemDrawing()
    drawing.line((0, -20), (30, -20), (30, 0), (16, 0), (16, -4), (26, -4), (26, -16), (0, -16), (0, -20))
    drawing.box(0, 12, -16, -4)
    drawing.box(0, 12, -4, 0)
    drawing.box(13, 15, -6, 2)
    drawing.label(20, -18, STEEL)
    drawing.label(6, -10, MAGNET, magdir=90)
    drawing.label(6, -2, STEEL)
    drawing.label(14, -2, COPPER, circuit=1, turns=100)
    return surrounded(drawing)


# Windings


def test_a_current_density_times_its_area_is_one_turn():
    drawing = suspension()
    drawing.relabel(COPPER, circuit=0)
    drawing.materials[COPPER]["J_re"] = -12.5
    result = imported(drawing)
    (coil,) = result.actuator.coils
    assert coil.turns == 1
    assert result.current_A == pytest.approx(-12.5 * 40)  # MA/m^2 times the 4 mm x 10 mm of the winding
    assert "J = -12.5 MA/m^2" in said(result, "current-density").text


def test_a_circuit_counts_before_a_current_density_beside_it():
    drawing = suspension()
    drawing.materials[COPPER]["J_re"] = 2.5
    result = imported(drawing)
    assert result.actuator == imported(suspension()).actuator
    assert said(result, "circuit-and-density").size == pytest.approx(2.5 * 40)


def test_a_current_density_gives_the_force_of_its_ampere_turns(tmp_path):
    drawing = suspension()
    expected = run_sweep(imported(drawing).actuator, tmp_path / "turns", workers=1).rows.iloc[0]
    drawing.relabel(COPPER, circuit=0)
    drawing.materials[COPPER]["J_re"] = 200 * 2 / 40
    row = run_sweep(imported(drawing).actuator, tmp_path / "density", workers=1).rows.iloc[0]
    # the same mesh and the same ampere-turns, but for the rounding of 400 A
    assert row["force_N"] == pytest.approx(expected["force_N"], rel=1e-9)
    assert row["flux_linkage_Wb"] == pytest.approx(expected["flux_linkage_Wb"] / 200, rel=1e-9)


def test_blocks_of_one_density_are_in_series_by_their_areas():
    drawing = suspension()
    drawing.relabel(COPPER, circuit=0)
    drawing.materials[COPPER]["J_re"] = 2
    drawing.materials["Back"] = {"J_re": -2}
    drawing.box(5, 9, 20, 40)  # twice the area
    drawing.label(7, 22, "Back")
    result = imported(drawing)
    assert result.currents_A == (80.0,)
    assert [coil.turns for coil in result.actuator.coils] == [1, 2]
    assert [coil.sign for coil in result.actuator.coils] == [1, -1]


def test_one_circuit_over_blocks_apart_becomes_coils_in_series():
    drawing = suspension()
    drawing.box(5, 9, 20, 25)
    drawing.label(7, 22, COPPER, circuit=1, turns=-100)
    actuator = imported(drawing).actuator
    assert [coil.turns for coil in actuator.coils] == [200, 100]
    (circuit,) = actuator.circuits
    assert [(coil.circuit, coil.sign) for coil in actuator.coils] == [(circuit.name, 1), (circuit.name, -1)]
    assert actuator.sweep.currents_A == (2,)


def test_blocks_of_uneven_density_that_touch_are_two_coils():
    drawing = suspension()
    drawing.line((5, -6), (9, -6))
    drawing.relabel(COPPER, turns=100, z=-9)
    drawing.label(7, -3, COPPER, circuit=1, turns=50)
    assert [coil.turns for coil in imported(drawing).actuator.coils] == [100, 50]


def test_a_winding_around_something_is_cut_and_keeps_its_turns():
    drawing = suspension()
    drawing.box(6, 8, -8, -4)
    drawing.label(7, -5, AIR)
    drawing.relabel(COPPER, z=-10)
    coils = imported(drawing).actuator.coils
    assert len(coils) == 2
    assert sum(coil.turns for coil in coils) == pytest.approx(200)


def two_circuits():
    drawing = suspension()
    drawing.circuits["lift"] = {"TotalAmps_re": -1.5, "CircuitType": 1}
    drawing.box(5, 9, 20, 27)
    drawing.label(7, 22, COPPER, circuit=2, turns=10)
    return drawing


def test_circuits_with_current_are_all_taken_each_with_its_own():
    result = imported(two_circuits(), currents_A=(0.0, 1.0))
    assert result.currents_A == (2.0, -1.5)
    assert [circuit.name for circuit in result.actuator.circuits] == ["coil", "lift"]
    assert tables(result)["sweep"]["current_A"] == {"coil": [0, 1, 2], "lift": [-1.5, 0, 1]}


def test_a_circuit_can_be_taken_alone_and_idle_ones_are_left_out():
    drawing = two_circuits()
    alone = imported(drawing, circuits=("lift",))
    assert [coil.turns for coil in alone.actuator.coils] == [10]
    assert "'coil' (2 A)" in said(alone, "left-circuits").text
    drawing.circuits["lift"]["TotalAmps_re"] = 0
    idle = said(imported(drawing), "idle-circuits")
    assert "'lift'" in idle.text
    offered = tuple(re.findall(r"--circuit (\w+)", idle.remedy))
    assert [circuit.name for circuit in imported(drawing, circuits=offered).actuator.circuits] == ["coil", "lift"]
    assert [coil.turns for coil in imported(drawing).actuator.coils] == [200]
    drawing.circuits["coil"]["TotalAmps_re"] = 0
    assert len(imported(drawing).actuator.circuits) == 2


def test_windings_alone_keep_those_without_current():
    drawing = FemDrawing()
    drawing.circuits = {name: {"TotalAmps_re": amps, "CircuitType": 1} for name, amps in (("in", 1), ("out", 0))}
    drawing.box(5, 9, -10, 0)
    drawing.box(12, 14, -8, -2)
    drawing.label(7, -5, COPPER, circuit=1, turns=100)
    drawing.label(13, -5, COPPER, circuit=2, turns=20)
    assert imported(surrounded(drawing)).currents_A == (1, 0)


def test_one_block_of_a_parallel_circuit_is_a_solid_turn():
    drawing = suspension()
    drawing.circuits["coil"]["CircuitType"] = 0
    drawing.relabel(COPPER, turns=1)
    assert "solid-turn" in codes(imported(drawing))


def test_magnets_without_a_winding_are_a_device_too(tmp_path):
    drawing = suspension()
    drawing.relabel(COPPER, name=AIR, circuit=0)
    result = imported(drawing)
    assert result.actuator.coils == ()
    assert "supply" not in tables(result)
    assert "current_A" not in tables(result)["sweep"]
    assert run_sweep(result.actuator, tmp_path, workers=1).rows["force_N"].iloc[0] > 0


# Movers


def test_a_winding_in_the_gap_of_a_magnet_system_moves(tmp_path):
    result = imported(voice_coil())
    assert result.actuator.moving.regions == ()
    assert result.actuator.coils[0].moves
    assert result.distance_m == 0.01  # from the yoke's bottom, which lies before it
    assert "voice coil" in said(result, "mover").text
    other = re.search(r"--moving-label (\d+)", said(result, "mover").remedy).group(1)
    assert len(imported(voice_coil(), moving_labels=(int(other),)).actuator.moving.regions) == 3
    rows = run_sweep(result.actuator, tmp_path, workers=1).rows
    assert rows["status"].tolist() == ["ok"]
    # F = k_m i with k_m = 2 pi r N B_r, B_r of 0.2 to 0.5 T in such a gap
    assert 2 * math.pi * 0.014 * 100 * 0.2 < abs(rows["force_N"].iloc[0]) / 2 < 2 * math.pi * 0.014 * 100 * 0.5


def test_of_two_windings_the_smaller_moves_and_the_other_can_be_named():
    drawing = FemDrawing()
    drawing.box(5, 9, -10, 0)
    drawing.box(5, 9, 3, 5)
    drawing.circuits["probe coil"] = {"TotalAmps_re": 1, "CircuitType": 1}
    drawing.label(7, -5, COPPER, circuit=1, turns=100)
    drawing.label(7, 4, COPPER, circuit=2, turns=20)
    result = imported(surrounded(drawing))
    assert [(coil.name, coil.moves) for coil in result.actuator.coils] == [("coil", False), ("probe_coil", True)]
    assert "--moving-label 1" in said(result, "mover").remedy
    assert imported(drawing, moving_labels=(1,)).actuator.coils[0].moves


def test_a_core_with_a_group_does_not_move_where_the_winding_has_one_too():
    drawing = suspension()  # core, winding and magnet in groups 1, 2 and 3
    drawing.relabel(MAGNET, group=0)
    assert "'N40'" in said(imported(drawing), "mover").text


def test_the_only_body_with_a_group_moves():
    drawing = suspension()
    drawing.relabel(STEEL, group=0)
    drawing.relabel(COPPER, group=0)
    drawing.box(0, 3, 20, 25)
    drawing.label(1, 22, MAGNET, magdir=90)  # two bodies with a magnet, one of them in group 3
    assert "(1.5, 6)" in said(imported(drawing), "mover").text


def slug_in_a_winding():
    """A slug that fills the bore of a winding."""
    drawing = FemDrawing()
    drawing.box(5, 9, -10, 10)
    drawing.box(0, 5, -15, 5)
    drawing.label(7, 0, COPPER, circuit=1, turns=100)
    drawing.label(2, -5, STEEL)
    return surrounded(drawing)


def test_a_winding_that_touches_the_mover_gives_way_once_the_mover_is_named():
    with pytest.raises(FemFileError, match="everything touches") as caught:
        imported(slug_in_a_winding())
    block = re.search(r"--moving-block (\S+ \S+) for block 'Pure Steel'", str(caught.value)).group(1)
    result = imported(slug_in_a_winding(), moving_blocks=tuple(shlex.split(block)))
    assert said(result, "trimmed-winding").severity == "warning"
    inner = min(r for r, _ in result.actuator.coils[0].vertices_m)
    assert inner == pytest.approx(5.08e-3)  # 2 % of the winding's 4 mm
    assert result.actuator.coils[0].turns == 100
    other = imported(slug_in_a_winding(), moving_blocks=(COPPER,))  # the same contact, the winding moves
    assert other.actuator.coils[0].moves
    assert other.actuator.coils[0].turns == 100


# Where it stands


def test_a_plunger_flush_with_the_end_of_its_shell_stands_at_zero():
    drawing = FemDrawing()
    drawing.box(8, 12, -20, -1)
    drawing.box(13, 15, -22, 0)
    drawing.box(0, 6, 0, 30)
    drawing.label(10, -5, COPPER, circuit=1, turns=100)
    drawing.label(14, -5, STEEL, group=1)
    drawing.label(3, 10, STEEL, group=3)
    result = imported(surrounded(drawing))
    assert result.distance_m == 0
    assert tables(result)["schema"] == 2
    past = imported(drawing, distances_mm=(-5.0, 5.0))
    assert past.actuator.sweep.distances_m == (-0.005, 0, 0.005)


def test_a_plunger_that_has_passed_every_corner_has_a_negative_distance():
    drawing = FemDrawing()
    drawing.box(8, 12, -20, 0)
    drawing.box(0, 6, -30, 20)
    drawing.label(10, -5, COPPER, circuit=1, turns=100)
    drawing.label(3, 10, STEEL)
    result = imported(surrounded(drawing))
    assert result.distance_m == -0.03
    assert result.frame.face_mm == 0


def test_a_body_level_with_the_fixed_parts_moves_towards_growing_z():
    drawing = FemDrawing()
    drawing.box(8, 12, -10, 10)
    drawing.box(0, 6, -10, 10)
    drawing.label(10, -5, COPPER, circuit=1, turns=100)
    drawing.label(3, 5, STEEL)
    result = imported(surrounded(drawing))
    assert "level" in codes(result)
    assert result.frame.up == 1


# Magnets and materials


@pytest.mark.parametrize(
    ("angle", "coercivity", "written"),
    [
        (0, 970000, "+r"),
        (180, 970000, "-r"),
        (0, -970000, "-r"),
        (90, 970000, "+z"),
        (45, 970000, [math.sqrt(0.5), math.sqrt(0.5)]),
        (135, -970000, [math.sqrt(0.5), -math.sqrt(0.5)]),
    ],
)
def test_a_fixed_magnet_may_point_anywhere(angle, coercivity, written):
    drawing = suspension()
    drawing.materials["Ring"] = {"Mu_x": 1.05, "Mu_y": 1.05, "H_c": coercivity}
    drawing.relabel(STEEL, name="Ring", magdir=angle)
    (region,) = tables(imported(drawing, moving_groups=(3,)))["fixed"]["regions"].values()
    assert region["magnetization"] == (written if isinstance(written, str) else pytest.approx(written, rel=1e-11))


def test_a_mirrored_drawing_turns_the_radial_magnetization_round(tmp_path):
    """B is an axial vector: in a mirror its z stays and its r turns round; the force is the same."""
    rows = []
    for below in (False, True):
        drawing = suspension(below=below)
        drawing.materials["Ring"] = {"Mu_x": 1.05, "Mu_y": 1.05, "H_c": 970000}
        drawing.relabel(STEEL, name="Ring", magdir=150 if below else 30)
        result = imported(drawing, moving_groups=(3,))
        assert [region.material.direction[0] > 0 for region in result.actuator.fixed] == [True]
        rows.append(run_sweep(result.actuator, tmp_path / str(below), workers=1).rows.iloc[0])
    assert rows[0]["force_N"] == pytest.approx(rows[1]["force_N"], rel=1e-9)


def test_a_magnet_with_a_demagnetisation_curve_becomes_its_recoil_line():
    drawing = suspension()
    slope, coercivity = 1.1 * MU_0, 900e3
    curve = [(slope * k * coercivity / 8, k * coercivity / 8) for k in range(9)]
    drawing.materials[MAGNET] = {"Mu_x": 1, "Mu_y": 1, "H_c": coercivity, "curve": curve}
    result = imported(drawing)
    material = result.actuator.moving.regions[0].material
    assert material.remanence_T == pytest.approx(slope * coercivity, rel=1e-9)
    assert material.relative_permeability == pytest.approx(1.1, rel=1e-9)
    assert said(result, "magnet-curve").size == pytest.approx(0, abs=1e-9)
    knee = [(0.0, 0.0), (0.3, 0.05 * coercivity), *((slope * h, h) for _, h in curve[4:])]
    drawing.materials[MAGNET]["curve"] = knee
    assert said(imported(drawing), "magnet-curve").size > 0.1


def test_laminated_steel_is_the_mean_of_its_sheets_and_gaps():
    drawing = suspension()
    drawing.materials[STEEL]["LamFill"] = 0.9
    material = imported(drawing).actuator.fixed[0].material
    assert material.relative_permeability == pytest.approx(0.9 * 500 + 0.1)
    drawing.materials[STEEL]["curve"] = ((0, 0), (1, 200), (1.5, 2000), (1.8, 12000), (2.1, 60000))
    assert imported(drawing).actuator.fixed[0].material.flux_density_T[1] == pytest.approx(0.9 + 0.1 * MU_0 * 200)


def test_a_problem_with_a_frequency_is_taken_for_its_static_field():
    result = imported(suspension(header={"Frequency": 50}))
    assert result.actuator == imported(suspension()).actuator
    assert "50 Hz" in said(result, "frequency").text


def test_a_formula_that_is_a_number_is_an_angle():
    drawing = suspension()
    drawing.relabel(MAGNET, formula="-90")
    drawing.relabel(MAGNET, magdir=0)
    assert imported(drawing).frame.field_sign == -1


# Surroundings


@pytest.mark.parametrize("flagged", [0, 1])
def test_the_outside_of_a_kelvin_transformation_is_left_out(flagged):
    drawing = suspension()
    drawing.boundaries = {"Kelvin": {"BdryType": 4}}
    drawing.line((0, 90), (0, 250))
    drawing.arc((0, 90), (0, 250), 180, 1)
    drawing.label(20, 150, AIR, flags=flagged)
    drawing.point_properties = {"infinity": {"A_re": 0}}
    drawing.points.append((0.0, 250.0, 1))
    result = imported(drawing)
    assert "kelvin" in codes(result)
    assert "near-boundary" not in codes(result)
    assert result.actuator == imported(suspension()).actuator


def test_an_outside_that_nothing_joins_is_said_to_have_ended_femms_field_at_a_wall():
    """FEMM solves such a file inside of its natural boundary, the outside drawn beside it has no field."""
    drawing = suspension(boundary=0)
    drawing.boundaries = {}
    drawing.line((0, 90), (0, 250))
    drawing.arc((0, 90), (0, 250), 180)
    drawing.label(20, 150, AIR, flags=1)
    wall = said(imported(drawing), "near-boundary")
    assert "natural" in wall.text
    assert wall.size == pytest.approx(80.0 - math.hypot(9.0, 11.0), abs=0.3)  # mm, coil's corner to arc's chords
    assert "3.3 %" in wall.remedy


# What is offered


@pytest.mark.parametrize("build", [suspension, voice_coil, two_circuits])
def test_the_axes_that_are_offered_are_taken_at_once(build):
    remedy = said(imported(build()), "one-point").remedy
    words = dict(word.split("=") for word in shlex.split(remedy.removesuffix(".")) if word.startswith("--"))
    result = imported(
        build(),
        distances_mm=axis_option(words["--distance-mm"], "--distance-mm"),
        currents_A=axis_option(words["--current-A"], "--current-A"),
    )
    assert len(result.actuator.sweep.distances_m) >= 10
    assert actuator_from_toml(result.toml) == result.actuator
