"""A bearing whose steel saturates, from its sweep by the commands to its loop, record, bench and audit."""

import json

import numpy as np
import pytest

import femfit as ff
from support.command import femfit, worked
from support.saturating_bearing import DISTANCES, inductance, write_sweep

ONE_SIDE = np.array([0.0, 1.0, 2.0, 3.0])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Swept from 0 A up, and fitted by the command."""
    folder = write_sweep(tmp_path_factory.mktemp("bearing") / "sweep", ONE_SIDE, ONE_SIDE)
    worked("fit", folder, "-o", folder / "model.json", "--json", folder / "fit.json")
    return folder


def test_voltages_move_it_and_reversed_together_as_they_do_forwards(folder):
    model = ff.read_model(folder / "model.json")
    moved = ff.simulate(model, voltage_V={"bottom": 1.2, "top": 0.4}, start_m=0.5e-3, duration_s=4e-3)
    assert not moved.extrapolated
    assert moved.table["distance_m"][-1] < 0.5e-3
    forwards, backwards = (
        ff.simulate(model, voltage_V={"bottom": sign * 5.0, "top": sign * 4.0}, start_m=0.5e-3, duration_s=1.2e-3)
        for sign in (1.0, -1.0)
    )
    assert backwards.table["time_s"][-1] == pytest.approx(1.2e-3)
    np.testing.assert_allclose(backwards.table["distance_m"][-1], forwards.table["distance_m"][-1], rtol=1e-9)


def test_an_audit_finds_a_quadratic_form_with_terms_of_magnets_wrong(folder):
    """As models of such devices were fitted before: a quadratic form with linear terms, valid for either sign."""
    right = json.loads((folder / "model.json").read_text())
    wrong, d = right | {"name": "as-before"}, DISTANCES
    knots = [0.2, 0.2, 0.2, 0.8, 0.8, 0.8]
    inverse = {"coordinate": "distance", "reference_distance_m": 1e-3, "u_knots": knots, "u_degree": 2}
    own = inductance(d[[0, 3, 6]], np.zeros((3, 2)))
    entries = [[0.002 * k, 3e-4 * k, -2e-4 * k, own[k, 0, 0], own[k, 0, 1], own[k, 1, 1]] for k in range(3)]
    wrong["magnetics"] = {
        "kind": "coenergy_matrix", "circuits": ["bottom", "top"], **inverse, "coefficients": entries,
    }  # fmt: skip
    wrong["validity"] = {key: value for key, value in right["validity"].items() if key != "mirrored"} | {
        "current_min_A": -3.0, "further_A": [[-3.0, 3.0]],
    }  # fmt: skip
    (folder / "before.json").write_text(json.dumps(wrong))
    told = femfit("audit", folder / "before.json", "--json", folder / "before-audit.json")
    assert told.returncode == 1
    found = json.loads((folder / "before-audit.json").read_text())["findings"]
    assert "point_misfit" in {one["code"] for one in found if one["severity"] == "wrong"}
    worked("audit", folder / "model.json", "--json", folder / "audit.json")
    found = {one["code"]: one for one in json.loads((folder / "audit.json").read_text())["findings"]}
    assert found["point_misfit"]["severity"] == "holds"
