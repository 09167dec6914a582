"""Closed loops of force and flux linkage: silent on true tables, with the factor on wrong ones."""

import numpy as np
import pytest

from femfit.tables.foreign_grid import settle_force_sign
from femfit.tables.foreign_reciprocity import check_reciprocity, flux_from_inductance

GRIDS = {
    "fine": np.linspace(5e-3, 25e-3, 41),
    "coarse": np.linspace(5e-3, 25e-3, 7),
    "uneven": np.array([5e-3, 6e-3, 8e-3, 11e-3, 15e-3, 20e-3, 28e-3]),
}
both_magnets = pytest.mark.parametrize("magnet", [True, False])
both_saturations = pytest.mark.parametrize("saturating", [True, False])


def only(findings):
    (finding,) = findings
    return finding


@both_magnets
@both_saturations
@pytest.mark.parametrize("grid", GRIDS)
def test_a_true_table_is_reciprocal(make_law, magnet, saturating, grid):
    finding = only(check_reciprocity(make_law(magnet, saturating).table(distances=GRIDS[grid])))
    assert finding.severity == "info"
    # Integrals of cubic splines over 7 distances and 4 currents: below 1 % on these laws.
    assert finding.size < (1e-4 if grid == "fine" and not saturating else 1e-2)


def test_noise_that_is_the_same_at_every_current_and_holes_do_not_disturb_it(law):
    noisy = law.table(distances=GRIDS["fine"])
    noisy["force_N"] += np.tile(np.random.default_rng(1).normal(0, 0.3 * np.abs(noisy["force_N"]).min(), 41), 4)
    for table in (noisy, law.table().drop(index=[3, 30, 50]).reset_index(drop=True)):
        finding = only(check_reciprocity(table))
        assert finding.severity == "info"
        assert finding.size < 1e-3


@both_magnets
@pytest.mark.parametrize(
    ("column", "factor", "ratio"),
    [
        ("flux_linkage_Wb", 1e3, 1e3),
        ("flux_linkage_Wb", 1 / 30, 1 / 30),
        ("flux_linkage_Wb", 1 / (2 * np.pi), 1 / (2 * np.pi)),
        ("flux_linkage_Wb", -1, -1),
        ("force_N", 1e3, 1e-3),
        ("force_N", 0.5, 2),
        ("distance_m", 1e3, 1e-3),
        ("current_A", 30, 30),
    ],
)
def test_a_wrong_unit_is_refused_with_its_factor(make_law, magnet, column, factor, ratio):
    table = make_law(magnet).table()
    table[column] *= factor
    finding = only(check_reciprocity(table))
    assert finding.severity == "error"
    assert finding.size == pytest.approx(ratio, rel=0.02)  # loops of cubic splines are right within 1 %


@both_saturations
@both_magnets
@pytest.mark.parametrize("currents", [(0.0, 0.4, 0.8, 1.2), (0.2, 0.6, 1.0, 1.4, 1.8), (-1.0, -0.5, 0.5, 1.0)])
def test_flux_divided_by_current_is_recognised(make_law, magnet, saturating, currents):
    table = make_law(magnet, saturating).table(currents)
    with np.errstate(invalid="ignore", divide="ignore"):
        table["flux_linkage_Wb"] /= table["current_A"]
    table.loc[table["current_A"] == 0, "flux_linkage_Wb"] = (
        0.0  # what such a script prints for 0/0 if it prints a number
    )
    finding = only(check_reciprocity(table))
    assert finding.severity == "error"
    assert "divided" in finding.text
    assert "HEADER=inductance" in finding.remedy


def test_differential_inductance_as_flux_is_recognised(make_law):
    law = make_law(magnet=False, saturating=True)
    table = law.table(np.linspace(0, 3, 13))
    step = 1e-4
    i, d = table["current_A"].to_numpy(), table["distance_m"].to_numpy()
    table["flux_linkage_Wb"] = (law.flux_linkage(d, i + step) - law.flux_linkage(d, i - step)) / (2 * step)
    finding = only(check_reciprocity(table))
    assert finding.severity == "error"
    assert "differential inductance" in finding.text


def test_a_flux_of_another_model_is_refused_and_a_constant_one_tells_nothing(law, make_law):
    table = law.table()
    shuffled = np.random.default_rng(2).permutation(table["flux_linkage_Wb"])
    fluxes = (shuffled, make_law(magnet=False).table()["flux_linkage_Wb"], 1e-3)
    severities = [only(check_reciprocity(table.assign(flux_linkage_Wb=flux))).severity for flux in fluxes]
    assert severities == ["error", "error", "warning"]


def test_inductance_is_flux_where_no_magnet_is_and_stays_inductance_beside_one(make_law, law):
    table = make_law(magnet=False, saturating=True).table()
    expected = table.pop("flux_linkage_Wb")
    table["inductance_H"] = (expected / table["current_A"]).where(table["current_A"] > 0)
    filled, findings = flux_from_inductance(table)
    np.testing.assert_allclose(filled["flux_linkage_Wb"], expected, rtol=1e-12)
    assert only(findings).severity == "info"
    table = law.table()
    apparent = (table.pop("flux_linkage_Wb") / table["current_A"]).where(table["current_A"] > 0)
    for inductance, fact in ((apparent, "zero current"), (1e-4 + 6e-6 / (table["distance_m"] + 8e-3), "")):
        filled, findings = flux_from_inductance(table.assign(inductance_H=inductance))
        assert "flux_linkage_Wb" not in filled
        assert fact in only(findings).text
    assert only(findings).severity == "warning"


@pytest.mark.parametrize(
    ("magnet", "currents"),
    [(magnet, i) for magnet in (True, False) for i in ((0.0, 0.5, 1.0), (0.3, 0.6, 1.2))]
    + [(False, (-1.0, -0.5, -0.1))],
)
def test_a_force_counted_away_from_the_magnet_is_turned(make_law, magnet, currents):
    table = make_law(magnet).table(currents)
    turned, findings = settle_force_sign(table.assign(force_N=-table["force_N"]), "auto")
    np.testing.assert_array_equal(turned["force_N"], table["force_N"])
    assert only(findings).code == "force-sign"
    same, findings = settle_force_sign(table, "auto")
    np.testing.assert_array_equal(same["force_N"], table["force_N"])
    assert findings == []


def test_the_users_word_on_the_sign_decides_and_other_polarities_are_said_and_not_changed(law):
    table = law.table()
    kept, _ = settle_force_sign(table.assign(force_N=-table["force_N"]), "keep")
    flipped, _ = settle_force_sign(table, "flip")
    assert (kept["force_N"] < 0).all()
    assert (flipped["force_N"] < 0).all()
    table = law.table()
    weaker = table.assign(force_N=law.force(table["distance_m"], -table["current_A"] / 4))
    same, findings = settle_force_sign(weaker, "auto")
    np.testing.assert_array_equal(same["force_N"], weaker["force_N"])
    assert "--flip-current" in only(findings).remedy
    mirrored = table.assign(distance_m=0.03 - table["distance_m"]).sort_values(["current_A", "distance_m"])
    _, findings = settle_force_sign(mirrored.reset_index(drop=True), "auto")
    assert only(findings).code == "distance-direction"
