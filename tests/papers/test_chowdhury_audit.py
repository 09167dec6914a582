"""The paper's set as printed gives the rows that follow from its numbers; a consistent set passes, a slip does not."""

import runpy
import sys
import tomllib
from pathlib import Path

import pytest
from papers.chowdhury_audit import audit_parameters

from femfit.audit.audit_model import Audit
from support.snapshot import check_snapshot

PAPER = Path(__file__).parents[2] / "data" / "chowdhury2016.toml"


@pytest.fixture(scope="module")
def paper():
    return {one.code: one for one in audit_parameters(tomllib.loads(PAPER.read_text(encoding="utf-8")))}


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
    assert paper[code].recomputed == pytest.approx(recomputed, rel=digits)


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
    return audit_parameters(data)


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


def test_one_command_prints_the_errata(renew, capsys, monkeypatch):
    script = str(Path(__file__).with_name("chowdhury_audit.py"))
    monkeypatch.setattr(sys, "argv", [script, str(PAPER)])
    runpy.run_path(script, run_name="__main__")
    check_snapshot("paper-audit", capsys.readouterr().out, renew=renew, least=16)
