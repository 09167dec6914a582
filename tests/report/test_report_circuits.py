"""The report on a device of several circuits: what they do together, against the closed forms of a bearing."""

import numpy as np
import pytest

from femfit.audit.audit_model import audit_model
from femfit.fit.build import fit_model
from femfit.model.json_file import write_model
from femfit.report.circuits import several_circuits
from support.bearing import ENTRY, Symmetric, table_of

TRUTH = Symmetric()
FLOATING = {**ENTRY, "mechanics": {"gravity_m_s2": 0.0}}


@pytest.fixture(scope="module")
def table():
    return table_of(TRUTH, entry=FLOATING)


@pytest.fixture(scope="module")
def fit(table):
    return fit_model(table)


@pytest.fixture(scope="module")
def several(fit):
    return several_circuits(fit.model)


def test_a_bearings_numbers_are_those_of_its_closed_form_and_one_circuit_has_no_such_chapter(several, levitation_model):
    middle = len(several.distance_m) // 2
    force = several.grid.force[:, middle]
    np.testing.assert_allclose(several.along, [1.0, -1.0], rtol=1e-3)
    np.testing.assert_allclose(force, -force[::-1], atol=1e-3 * np.abs(force).max())  # of the fit
    np.testing.assert_allclose(several.bias_A, [1.0, 1.0])  # half of 2 A: without a magnet nothing holds at 0 A
    np.testing.assert_allclose(several.holding_A[middle], several.bias_A, rtol=1e-3)
    per_current = TRUTH.force_per_current(1.0)
    np.testing.assert_allclose(several.force_per_A[middle], [per_current, -per_current], rtol=5e-3)
    assert several.stiffness_N_per_m[middle] == pytest.approx(TRUTH.stiffness(1.0), rel=0.02)  # a second derivative
    own = TRUTH.AREA / (0.5 * TRUTH.GAP + TRUTH.PATH)
    assert several.coupling[middle] == pytest.approx(1e-3 / own, rel=5e-3)
    assert several_circuits(levitation_model) is None


def test_the_currents_that_hold_balance_the_weight():
    model = fit_model(table_of(TRUTH)).model  # it stands: 4.9 N pull it down
    several = several_circuits(model)
    force = model.magnetics.force(several.distance_m, several.holding_A)
    np.testing.assert_allclose(force, -9.81 * 0.5, rtol=1e-8)


def test_the_audit_knows_several_circuits(table, fit, tmp_path):
    write_model(fit.model, tmp_path / "model.json")
    table.rows.to_csv(tmp_path / "sweep.csv", index=False)
    (tmp_path / "manifest.json").write_text("{}")
    audit = audit_model(tmp_path / "model.json", tmp_path / "sweep.csv")
    found = {(one.code, one.about): one for one in audit.findings}
    assert all(one.severity in {"holds", "note"} for one in audit.findings), str(audit)
    assert found["misfit", "force"].severity == "holds"
    assert found["reciprocity", "force and flux linkage"].recomputed < 1e-5
    # The slower of the two circuits at its least gap, eigenvalues of R^-1 L
    d = np.array([0.2e-3, 0.8e-3])
    inductance = TRUTH.matrix(d)[0][:, 1:, 1:] + np.diag([0.0, 1e-3])
    slowest = np.linalg.eigvals(inductance / np.array([1.5, 1.2])[:, None]).real.max()
    assert found["time_constant", "coil"].recomputed == pytest.approx(slowest, rel=5e-3)
    assert ("held_range", "what the currents hold") in found
