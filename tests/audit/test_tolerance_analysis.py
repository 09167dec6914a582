"""A drawing's tolerances: gradients by homogeneity, scatter and shares by solving drawings of a series."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from femfit.audit.tolerance_analysis import analyse_tolerances
from femfit.core.errors import MissingPartError, UsageError
from femfit.device.load import actuator_from_tables, parse
from femfit.field.layout import layout_of
from femfit.field.problem import prepare
from femfit.field.tolerance import SolverSettings
from femfit.tables.sweep_table import read_sweep_table
from support.small_drawing import SMALL

HEIGHT, RADIUS = "moving.regions.magnet.z_mm[1]", "fixed.regions.core.r_mm[1]"


@pytest.fixture(scope="module")
def table(small_sweep):
    return read_sweep_table(small_sweep / "run")


@pytest.mark.parametrize("quantity", ["force_N", "flux_linkage_Wb"])
def test_remanence_and_turns_together_make_twice_the_quantity(table, quantity):
    """Where the iron is linear, the field grows with both sources: Euler's theorem for homogeneous functions."""
    for distance, current in table.rows[["distance_m", "current_A"]].itertuples(index=False):
        found = analyse_tolerances(table, distance_m=distance, currents_A=[current], quantity=quantity)
        gradients = {one.number.effect: one.gradient for one in found.shares}
        assert gradients["remanence"] + gradients["turns"] == pytest.approx(2.0 * found.value, rel=1e-4)


def test_the_scatter_is_the_root_of_the_sum_of_squares_and_shares_add_up_to_one(table):
    distance, current = table.rows[["distance_m", "current_A"]].iloc[0]
    found = analyse_tolerances(table, distance_m=distance, currents_A=[current])
    alone = [abs(one.gradient) * one.number.tolerance for one in found.shares]
    assert found.scatter == pytest.approx(np.linalg.norm(alone), rel=1e-12)
    assert sum(one.share for one in found.shares) == pytest.approx(1.0)
    assert alone == sorted(alone, reverse=True)
    assert found.shares[0].number.title in str(found)


@pytest.mark.nightly
def test_shares_are_sobols_indices_of_drawings_that_are_solved(table):
    """By Saltelli's estimate from 256 drawings of which two dimensions scatter; good to a few hundredths."""
    distance, current = table.rows[["distance_m", "current_A"]].iloc[0]
    found = analyse_tolerances(table, distance_m=distance, currents_A=[current])
    lines = {HEIGHT: "r_mm = [0, 4]\nz_mm = [0, {:.9f}]", RADIUS: "r_mm = [0, {:.9f}]\nz_mm = [-10, 0]"}
    chosen = {one.number.key: one for one in found.shares if one.number.key in lines}

    def force(samples):
        values = []
        for sample in samples.T:
            text = SMALL
            for (key, line), value in zip(lines.items(), sample, strict=True):
                drawn = line.format(chosen[key].number.value).replace(".000000000", "")
                assert drawn in text
                text = text.replace(drawn, line.format(value))
            actuator = actuator_from_tables(parse(text, "small"), "small", None)
            problem = prepare(actuator, (distance,), layout_of(actuator, SolverSettings()), SolverSettings())
            values.append(problem.rows(distance, [current])["force_N"][0])
        return np.array(values)

    dists = [stats.norm(chosen[key].number.value, chosen[key].number.tolerance) for key in lines]
    indices = stats.sobol_indices(func=force, n=64, dists=dists, rng=np.random.default_rng(2))
    variances = np.array([chosen[key].scatter ** 2 for key in lines])
    np.testing.assert_allclose(indices.first_order, variances / variances.sum(), atol=0.05)
    np.testing.assert_allclose(indices.total_order, variances / variances.sum(), atol=0.05)


def test_what_is_asked_for_must_be_there(table):
    with pytest.raises(MissingPartError, match="--signatures"):
        analyse_tolerances(replace(table, signatures=None), distance_m=5e-3, currents_A=[0.5])
    for wrong, said in (
        ({"distance_m": 20e-3}, r"4\.000 mm to 12\.00 mm; got 20\.00 mm"),
        ({"currents_A": [0.5, 0.5]}, "one number for each of current_A; got 2"),
        ({"quantity": "stiffness"}, "quantity must be one of force_N"),
    ):
        with pytest.raises(UsageError, match=said):
            analyse_tolerances(table, **{"distance_m": 5e-3, "currents_A": [0.5]} | wrong)
