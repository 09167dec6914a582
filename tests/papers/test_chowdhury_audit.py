"""The paper's set as printed gives the rows that follow from its numbers; a consistent set passes, a slip does not."""

import subprocess
import sys
from pathlib import Path

import pytest
from papers.parameter_audit.audit_parameters import audit_parameters
from papers.parameter_audit.parameters import ParameterSet, read_parameters

from femfit.audit.audit_model import Audit
from femfit.core.errors import TableError

PAPER = Path(__file__).parents[2] / "data" / "chowdhury2016.toml"


@pytest.fixture(scope="module")
def paper():
    return {(one.code, one.about): one for one in audit_parameters(read_parameters(PAPER))}


@pytest.mark.parametrize(
    ("code", "recomputed", "digits"),
    [
        # Recomputed independently of this project, to the digits given here
        ("coil_resistance", 0.95, 0.01),
        ("mean_a", 5.9964e-9, 1e-4),
        ("slope_b", 4.510e-6, 3e-4),
        ("J3", 1.99e-14, 3e-3),
        ("slack_bounds", 1.02e-3, 0.01),
        ("difference_mean", 1.35e-3, 5e-3),
        ("difference_sd", 0.93e-3, 5e-3),
        ("linear_in_current", 0.015, 0.02),
        ("held_range", 20.9, 3e-3),
        ("back_emf", 9.3e-3, 5e-3),
        ("mass_missing", 229.9, 1e-3),
        ("magnet_mass", 3.56, 2e-3),
        ("noise_reduction", 6.0, 0.01),
    ],
)
def test_the_papers_numbers_are_recomputed(paper, code, recomputed, digits):
    (one,) = (finding for (name, _), finding in paper.items() if name == code)
    assert one.recomputed == pytest.approx(recomputed, rel=digits)


def test_each_row_of_the_errata_that_follows_from_the_numbers_is_there(paper):
    severities = {}
    for (code, _), one in paper.items():
        severities.setdefault(one.severity, set()).add(code)
    assert severities["wrong"] == {
        "coil_resistance", "one_coil", "bounds", "slack_bounds", "law_twice", "difference_sd", "linear_in_current",
        "misprint", "held_range", "gravity", "mass_missing", "force_sign", "back_emf", "mean_weights",
        "covariance_weights", "single_precision", "noise_unit", "noise_reduction", "hall_constant", "pid",
    }  # fmt: skip
    assert {"magnet_mass", "residual_rms", "difference_mean"} <= severities["note"]
    assert {"mean_a", "slope_b", "J3", "hall_field", "coil_room"} <= severities["holds"]


@pytest.mark.parametrize(
    ("code", "parts"),
    [
        ("one_coil", ("30 as printed", "308 by its inductance")),
        ("linear_in_current", ("F = 11.4", "p = 0.015")),
        ("held_range", ("19.6 to 20.9 mm", "7 A")),
        ("mean_weights", ("sum to -300", "should to 1", "-249999", "41666.67")),
        ("covariance_weights", ("sum to -400", "should to 4")),
        ("residual_rms", ("14 %", "part without current")),
        ("misprint", ("7.464e-06", "7.135e-09")),
        ("hall_constant", ("must be subtracted", "46.9 mm")),
        ("pid", ("1.037",)),
        ("gravity", ("9.89 and 9.83",)),
    ],
)
def test_a_row_says_both_numbers(paper, code, parts):
    (one,) = (finding for (name, _), finding in paper.items() if name == code)
    for part in parts:
        assert part in one.sentence


TURNS, SLOPE = 308.0, 3.6e-5


def consistent():
    """A coil, magnet, law and filter that belong together."""
    rate_safe = {"states": 3, "alpha": 1.0, "beta": 2.0, "kappa": 0.0, "sample_time_s": 0.5e-3}
    weights = {"mean_weights": [-2.0, *[0.5] * 6], "covariance_weights": [0.0, *[0.5] * 6]}
    noise = {"measurement_noise": 0.0025, "noise_unit": "mm2", "direct_rms_m": [5e-5], "filtered_rms_m": [1.2e-5]}
    terms = [
        {"value": 4.2e-9, "distance_power": -4},
        {"value": SLOPE, "distance_power": -2, "current_power": 1},
    ]
    mass = 3.56e-3
    return {
        "name": "rig",
        "source": "made for this test",
        "magnet": {"diameter_mm": 11.0, "height_mm": 5.0, "mass_g": 1e3 * mass, "remanence_T": 1.45},
        "coil": {
            "turns": TURNS, "wire_diameter_mm": 0.49, "inner_diameter_mm": 20.0, "outer_diameter_mm": 40.0,
            "height_mm": 15.0, "resistance_ohm": 2.69, "inductance_H": 1.71197e-7 * TURNS**2,
            "inductance_per_turn2_H": 1.71197e-7, "force_per_ampere_turn_N": SLOPE / 0.02**2 / TURNS,
            "force_distance_mm": 20.0,
        },
        "force": {
            "terms": terms, "distance_min_mm": 15.0, "distance_max_mm": 45.0, "points": 61, "lower_bound": 0.0,
            "upper_bound": 1e-4, "mean_a": 4.2e-9, "slope_b": SLOPE,
            "rows": [
                {"current_A": 0.2 * k, "a": 4.2e-9, "b": 0.2 * k * SLOPE * (1 + 1e-4 * (-1) ** k), "J1": 1e-6 * (1 + k)}
                for k in range(1, 8)
            ],
            "says_linear_in_current": True,
        },
        "supply": {"voltage_min_V": 0.3, "voltage_max_V": 3.0, "held_min_mm": 22.0, "held_max_mm": 30.0},
        "equations": {
            "gravity_m_s2": [9.81],
            "acceleration_terms": [dict(term, value=-term["value"] / mass) for term in terms],
            "current_per_A": -165.6, "current_per_V": 61.61, "has_back_emf": True,
        },
        "filter": rate_safe | weights | noise,
        "hall": {"constant_V": -2.5, "quiescent_V": 2.5, "polynomial_mm": [-20.0, 45.0]},
        "pid": {"past": [1.6, -0.6], "error": [-623.9, 1220.0, -596.4]},
    }  # fmt: skip


def audited(data):
    return audit_parameters(ParameterSet.model_validate(data))


def test_a_consistent_set_passes_clean():
    findings = audited(consistent())
    assert [one for one in findings if one.severity == "wrong"] == []
    assert str(Audit(tuple(findings))).startswith("0 wrong")


@pytest.mark.parametrize(
    ("section", "key", "value", "code"),
    [
        ("coil", "turns", 30.0, "one_coil"),
        ("coil", "resistance_ohm", 12.0, "coil_resistance"),
        ("coil", "wire_diameter_mm", 0.9, "coil_room"),
        ("force", "mean_a", 4.5e-9, "mean_a"),
        ("force", "slope_b", 4.0e-5, "slope_b"),
        ("force", "upper_bound", 1e-6, "bounds"),
        ("supply", "held_max_mm", 44.0, "held_range"),
        ("equations", "gravity_m_s2", [9.89], "gravity"),
        ("equations", "has_back_emf", False, "back_emf"),
        ("equations", "current_per_A", 165.6, "current_signs"),
        ("filter", "mean_weights", [-2.0, *[0.4] * 6], "mean_weights"),
        ("filter", "noise_unit", "", "noise_unit"),
        ("filter", "filtered_rms_m", [3e-6], "noise_reduction"),
        ("hall", "constant_V", 250.0, "hall_constant"),
    ],
)
def test_each_slip_is_found_by_its_own_check(section, key, value, code):
    data = consistent()
    data[section] = dict(data[section], **{key: value})
    assert code in {one.code for one in audited(data) if one.severity == "wrong"}


def test_a_file_with_unknown_keys_names_every_one(tmp_path):
    (tmp_path / "p.toml").write_text('name = "x"\nsource = "y"\n[coil]\nturn = 3\n[magnet]\nmass_g = "four"\n')
    with pytest.raises(TableError) as error:
        read_parameters(tmp_path / "p.toml")
    for part in ("coil.turn", "magnet.mass_g", "magnet.diameter_mm"):
        assert part in str(error.value)


def test_an_actuator_file_is_told_apart():
    with pytest.raises(TableError, match="is an actuator file"):
        read_parameters(PAPER.parents[1] / "geometry" / "emaws.toml")


def test_one_command_prints_the_findings():
    script = Path(__file__).with_name("chowdhury_audit.py")
    done = subprocess.run([sys.executable, script, PAPER], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("20 wrong")
