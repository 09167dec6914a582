"""Noise, reciprocity and sign of imported forces: silent on true tables, with size and factor on wrong ones."""

import numpy as np
import pytest

from femfit.tables.checks import checked
from femfit.tables.sweep_checks import force_noise, force_sign, reciprocity
from support.force_law import Law

GRIDS = {
    "fine": np.linspace(5e-3, 25e-3, 41),
    "coarse": np.linspace(5e-3, 25e-3, 7),
    "uneven": np.array([5e-3, 6e-3, 8e-3, 11e-3, 15e-3, 20e-3, 28e-3]),
}
both_magnets = pytest.mark.parametrize("magnet", [True, False])


def only(findings):
    (finding,) = findings
    return finding


def reciprocal(table):
    return only(reciprocity(table, None))


@both_magnets
@pytest.mark.parametrize("saturating", [True, False])
@pytest.mark.parametrize("grid", GRIDS)
def test_a_true_table_is_reciprocal(magnet, saturating, grid):
    finding = reciprocal(Law(magnet, saturating).table(distances=GRIDS[grid]))
    assert finding.severity == "info"
    # Integrals of cubic splines over 7 distances and 4 currents: below 1 % on these laws.
    assert finding.size < (1e-4 if grid == "fine" and not saturating else 1e-2)


def test_noise_that_is_the_same_at_every_current_and_holes_do_not_disturb_it():
    noisy = Law().table(distances=GRIDS["fine"])
    noisy["force_N"] += np.tile(np.random.default_rng(1).normal(0, 0.3 * np.abs(noisy["force_N"]).min(), 41), 4)
    for table in (noisy, Law().table().drop(index=[3, 30, 50]).reset_index(drop=True)):
        finding = reciprocal(table)
        assert finding.severity == "info"
        assert finding.size < 1e-3


@both_magnets
@pytest.mark.parametrize(
    ("column", "factor", "ratio"),
    [
        ("flux_linkage_Wb", 1 / 30, 1 / 30),
        ("flux_linkage_Wb", -1, -1),
        ("force_N", 1e3, 1e-3),
        ("distance_m", 1e3, 1e-3),
        ("current_A", 30, 30),
    ],
)
def test_a_wrong_unit_is_refused_with_its_factor(magnet, column, factor, ratio):
    table = Law(magnet).table()
    table[column] *= factor
    finding = reciprocal(table)
    assert finding.severity == "error"
    assert finding.size == pytest.approx(ratio, rel=0.02)  # loops of cubic splines are right within 1 %


def test_a_flux_of_another_model_and_an_inductance_are_refused_and_a_constant_one_tells_nothing():
    table = Law().table()
    shuffled = np.random.default_rng(2).permutation(table["flux_linkage_Wb"])
    inductance = table["flux_linkage_Wb"] / table["current_A"].where(table["current_A"] > 0)
    fluxes = (shuffled, Law(magnet=False).table()["flux_linkage_Wb"], inductance, 1e-3)
    severities = [reciprocal(table.assign(flux_linkage_Wb=flux)).severity for flux in fluxes]
    assert severities == ["error", "error", "error", "warning"]


@both_magnets
@pytest.mark.parametrize("share", [0.0, 0.01, 0.05])
def test_the_noise_of_a_force_is_its_scatter_and_a_smooth_force_has_none(magnet, share):
    table = Law(magnet).table(currents=(0.4, 0.8), distances=GRIDS["fine"])
    noise = share * table["force_N"] * np.random.default_rng(3).standard_normal(len(table))
    judged, findings = checked(table.assign(force_N=table["force_N"] + noise), (force_noise,))
    assert only(findings).severity == ("warning" if share else "info")
    # Of 300 draws 98 % lie within 0.57 to 1.37 of the truth, and the larger one of two curves counts.
    assert only(findings).size == pytest.approx(share, rel=0.45, abs=1e-4)
    assert judged["force_error_N"].median() == pytest.approx(share * table["force_N"].median(), rel=0.6, abs=1e-4)


@pytest.mark.parametrize(
    ("magnet", "currents"),
    [(magnet, i) for magnet in (True, False) for i in ((0.0, 0.5, 1.0), (0.3, 0.6, 1.2))]
    + [(False, (-1.0, -0.5, -0.1))],
)
def test_a_force_counted_away_from_the_magnet_is_turned(magnet, currents):
    table = Law(magnet).table(currents)
    turned, findings = checked(table.assign(force_N=-table["force_N"]), (force_sign,))
    np.testing.assert_array_equal(turned["force_N"], table["force_N"])
    assert only(findings).code == "force-sign"
    same, findings = checked(table, (force_sign,))
    np.testing.assert_array_equal(same["force_N"], table["force_N"])
    assert findings == []


def test_other_polarities_are_said_and_not_changed():
    table = Law().table()
    weaker = table.assign(force_N=Law().force(table["distance_m"], -table["current_A"] / 4))
    same, findings = checked(weaker, (force_sign,))
    np.testing.assert_array_equal(same["force_N"], weaker["force_N"])
    assert "--unit current=-1" in only(findings).remedy
    mirrored = table.assign(distance_m=0.03 - table["distance_m"]).sort_values(["current_A", "distance_m"])
    _, findings = checked(mirrored.reset_index(drop=True), (force_sign,))
    assert only(findings).code == "distance-direction"
