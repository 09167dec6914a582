"""Closed loops of force and flux linkage: silent on true tables, and the factor said on wrong ones."""

import numpy as np
import pytest

from femfit.tables.foreign.grid import settle_force_sign
from femfit.tables.foreign.reciprocity import check_reciprocity, flux_from_inductance

GRIDS = {
    "fine": np.linspace(5e-3, 25e-3, 41),
    "coarse": np.linspace(5e-3, 25e-3, 7),
    "uneven": np.array([5e-3, 6e-3, 8e-3, 11e-3, 15e-3, 20e-3, 28e-3]),
}


def only(findings):
    assert len(findings) == 1
    return findings[0]


@pytest.mark.parametrize("magnet", [True, False])
@pytest.mark.parametrize("saturating", [True, False])
@pytest.mark.parametrize("grid", GRIDS)
def test_a_true_table_is_reciprocal(make_law, magnet, saturating, grid):
    finding = only(check_reciprocity(make_law(magnet, saturating).table(distances=GRIDS[grid])))
    assert finding.severity == "info"
    # Integrals of cubic splines over 7 distances and 4 currents: below 1 % on these laws.
    assert finding.size < (1e-4 if grid == "fine" and not saturating else 1e-2)


def test_self_force_noise_does_not_disturb_reciprocity(law):
    table = law.table(distances=GRIDS["fine"])
    levels = np.random.default_rng(1).normal(0, 0.3 * np.abs(table["force"]).min(), 41)
    table["force"] += np.tile(levels, 4)
    finding = only(check_reciprocity(table))
    assert finding.severity == "info"
    assert finding.size < 1e-3  # an error that is the same at every current cancels in the loops


@pytest.mark.parametrize("magnet", [True, False])
@pytest.mark.parametrize(
    ("column", "factor", "ratio"),
    [
        ("flux_linkage", 1e3, 1e3),
        ("flux_linkage", 1 / 30, 1 / 30),
        ("flux_linkage", 1 / (2 * np.pi), 1 / (2 * np.pi)),
        ("flux_linkage", -1, -1),
        ("force", 1e3, 1e-3),
        ("force", 0.5, 2),
        ("distance", 1e3, 1e-3),
        ("current", 30, 30),
    ],
)
def test_a_wrong_unit_is_refused_with_its_factor(make_law, magnet, column, factor, ratio):
    table = make_law(magnet).table()
    table[column] *= factor
    finding = only(check_reciprocity(table))
    assert finding.severity == "error"
    assert finding.size == pytest.approx(ratio, rel=0.02)  # loops of cubic splines are right within 1 %
    assert f"{finding.size:.4g} times dF/di" in finding.text


@pytest.mark.parametrize("saturating", [True, False])
@pytest.mark.parametrize("magnet", [True, False])
@pytest.mark.parametrize("currents", [(0.0, 0.4, 0.8, 1.2), (0.2, 0.6, 1.0, 1.4, 1.8), (-1.0, -0.5, 0.5, 1.0)])
def test_flux_divided_by_current_is_recognised(make_law, magnet, saturating, currents):
    table = make_law(magnet, saturating).table(currents)
    with np.errstate(invalid="ignore", divide="ignore"):
        table["flux_linkage"] /= table["current"]
    table.loc[table["current"] == 0, "flux_linkage"] = 0.0  # what such a script prints for 0/0 if it prints a number
    finding = only(check_reciprocity(table))
    assert finding.severity == "error"
    assert "divided by the current" in finding.text
    assert "--column HEADER=inductance" in finding.remedy


def test_differential_inductance_as_flux_is_recognised(make_law):
    law = make_law(magnet=False, saturating=True)
    table = law.table(np.linspace(0, 3, 13))
    step = 1e-4
    i, d = table["current"].to_numpy(), table["distance"].to_numpy()
    table["flux_linkage"] = (law.flux_linkage(d, i + step) - law.flux_linkage(d, i - step)) / (2 * step)
    finding = only(check_reciprocity(table))
    assert finding.severity == "error"
    assert "differential inductance" in finding.text


def test_a_flux_of_another_model_is_refused(law, make_law):
    table = law.table()
    table["flux_linkage"] = np.random.default_rng(2).permutation(table["flux_linkage"])
    assert only(check_reciprocity(table)).severity == "error"
    other = make_law(magnet=False).table()
    assert only(check_reciprocity(law.table().assign(flux_linkage=other["flux_linkage"]))).severity == "error"


def test_a_constant_flux_is_said_to_tell_nothing(law):
    table = law.table().assign(flux_linkage=1e-3)
    assert only(check_reciprocity(table)).severity == "warning"


def test_holes_are_worked_around(law):
    table = law.table().drop(index=[3, 30, 50]).reset_index(drop=True)
    finding = only(check_reciprocity(table))
    assert finding.severity == "info"
    assert finding.size < 1e-3


def test_inductance_times_current_is_flux_where_no_magnet_is(make_law):
    law = make_law(magnet=False, saturating=True)
    table = law.table()
    expected = table.pop("flux_linkage")
    table["inductance"] = (expected / table["current"]).where(table["current"] > 0)
    filled, findings = flux_from_inductance(table)
    np.testing.assert_allclose(filled["flux_linkage"], expected, rtol=1e-12)
    assert only(findings).severity == "info"


def test_inductance_beside_a_magnet_is_no_flux_at_zero_current(law):
    table = law.table()
    table["inductance"] = (table.pop("flux_linkage") / table["current"]).where(table["current"] > 0)
    filled, findings = flux_from_inductance(table)
    assert "flux_linkage" not in filled
    assert "zero current" in only(findings).text


def test_differential_inductance_beside_a_magnet_is_kept_as_inductance(law):
    table = law.table()
    table["inductance"] = 1e-4 + 6e-6 / (table.pop("distance") + 8e-3)
    table["distance"] = law.table()["distance"]
    filled, findings = flux_from_inductance(table.drop(columns="flux_linkage"))
    assert "flux_linkage" not in filled
    assert only(findings).severity == "warning"


@pytest.mark.parametrize("magnet", [True, False])
@pytest.mark.parametrize("currents", [(0.0, 0.5, 1.0), (0.3, 0.6, 1.2), (-1.0, -0.5, -0.1)])
def test_a_force_counted_away_from_the_magnet_is_turned(make_law, magnet, currents):
    table = make_law(magnet).table(currents)
    if magnet and min(currents) < 0:
        pytest.skip("a current that weakens the magnet: the polarity is reversed, not the force")
    turned, findings = settle_force_sign(table.assign(force=-table["force"]), "auto")
    np.testing.assert_array_equal(turned["force"], table["force"])
    assert "negated" in only(findings).text
    kept, findings = settle_force_sign(table, "auto")
    np.testing.assert_array_equal(kept["force"], table["force"])
    assert findings == []


def test_the_users_word_on_the_sign_decides(law):
    table = law.table()
    kept, _ = settle_force_sign(table.assign(force=-table["force"]), "keep")
    assert (kept["force"] < 0).all()
    flipped, _ = settle_force_sign(table, "flip")
    assert (flipped["force"] < 0).all()


def test_a_repelling_polarity_is_said_and_not_changed(law):
    table = law.table()
    weaker = table.assign(force=law.force(table["distance"], -table["current"] / 4))
    same, findings = settle_force_sign(weaker, "auto")
    np.testing.assert_array_equal(same["force"], weaker["force"])
    assert "--flip-current" in only(findings).remedy


def test_a_force_that_grows_with_distance_is_said(law):
    table = law.table()
    reversed_axis = table.assign(distance=0.03 - table["distance"]).sort_values(["current", "distance"])
    _, findings = settle_force_sign(reversed_axis.reset_index(drop=True), "auto")
    assert [finding.code for finding in findings] == ["distance-direction"]
