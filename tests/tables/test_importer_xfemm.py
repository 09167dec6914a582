"""Tables of a first-order field solver: the plain force warns, the self-subtracted one is right within its error."""

import numpy as np
import pytest

from femfit.tables.foreign.options import ImportOptions
from femfit.tables.foreign.read import read_foreign_table
from support.reference import REFERENCE, needs_reference

pytestmark = needs_reference
SWEEP = REFERENCE / "emaws_xfemm_488.csv"

# Converged F0 (N) and F1 (N/A), order 6, open domain (papers/ERRATA.md); changes below 0.01 %.
CONVERGED = {
    0.015: (0.0803275, 0.0110974),
    0.020: (0.0261666, 0.0085470),
    0.030: (0.0045700, 0.0046488),
    0.040: (0.0011833, 0.0025463),
}


def read(column):
    return read_foreign_table([SWEEP], ImportOptions(columns={column: "force", "Bz_axis_face_T": "hall"}))


def codes(imported, severity):
    return {finding.code for finding in imported.findings if finding.severity == severity}


def test_the_plain_force_raises_the_warning_with_its_size():
    imported = read("force_N")
    (finding,) = [finding for finding in imported.findings if finding.code == "self-force"]
    assert finding.severity == "warning"
    assert 0.05 < finding.size < 0.3  # second differences of 18 % of F, so about 7..13 % of standard deviation
    assert "the same at every current" in finding.text
    (rival,) = [finding for finding in imported.findings if finding.code == "rival-force"]
    assert rival.size == pytest.approx(0.42, abs=0.03)  # median error that the peer reports against converged


def test_the_self_subtracted_force_raises_none():
    imported = read("force_selfsub_N")
    assert codes(imported, "warning") == set()
    assert codes(imported, "error") == set()
    (noise,) = [finding for finding in imported.findings if finding.code == "noise"]
    assert 0.0005 < noise.size < 0.004  # the peer's own error: median 0.1 %, largest 0.4 %


def test_the_core_reaction_is_less_rough_than_it_is_wrong():
    imported = read("force_core_reaction_N")
    assert codes(imported, "warning") == {"rival-force", "self-force"}
    (noise,) = [finding for finding in imported.findings if finding.code == "self-force"]
    (rival,) = [finding for finding in imported.findings if finding.code == "rival-force"]
    assert 0.01 < rival.size < 0.03  # its median error against converged is 2 %
    assert noise.size < rival.size / 2  # most of that varies slowly with the distance


def test_the_self_subtracted_force_is_known_to_a_per_cent():
    rows = read("force_selfsub_N").rows
    assert (rows["force_error_N"] < 0.01 * rows["force_N"]).all()


@pytest.mark.parametrize("column", ["force_N", "force_core_reaction_N", "force_selfsub_N"])
def test_the_error_of_each_row_is_true(column):
    rows = read(column).rows
    deviations = [
        (row.force_N - CONVERGED[d][0] - CONVERGED[d][1] * row.current_A) / row.force_error_N
        for row in rows.itertuples()
        for d in [round(row.distance_m, 6)]
        if d in CONVERGED
    ]
    assert len(deviations) == 32
    assert np.max(np.abs(deviations)) < 4  # standard deviations, of four distances with errors of their own
    assert np.median(np.abs(deviations)) > 0.1  # and not so large as to mean nothing


def test_flux_linkage_and_force_are_reciprocal():
    for column in ("force_N", "force_core_reaction_N", "force_selfsub_N"):
        (finding,) = [finding for finding in read(column).findings if finding.code == "reciprocity"]
        assert finding.severity == "info"
        assert finding.size < 2e-3


def test_hall_field_and_grid_come_through():
    rows = read("force_selfsub_N").rows
    assert (rows["current_A"].nunique(), rows["distance_m"].nunique(), len(rows)) == (8, 61, 488)
    at = rows[(rows["current_A"] == 0) & np.isclose(rows["distance_m"], 0.02)]
    assert at["hall_T"].iloc[0] == pytest.approx(8.6864e-3, rel=0.05)  # constant B in each first-order element


def test_the_steel_plunger_is_reciprocal_and_too_short_to_judge():
    imported = read_foreign_table([REFERENCE / "steel_xfemm.csv"])
    assert codes(imported, "error") == set()
    (finding,) = [finding for finding in imported.findings if finding.code == "reciprocity"]
    assert finding.severity == "info"
    assert any("not judged" in finding.text for finding in imported.findings)
