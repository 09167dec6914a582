"""The report on a device of several circuits: what they do together, against the closed forms of a bearing."""

import numpy as np
import pytest

from femfit.audit.audit_model import audit_model
from femfit.device.load import read_actuator
from femfit.device.starters import starter_text
from femfit.fit.build import fit_model
from femfit.model.json_file import write_model
from femfit.report.actuator_report import draw_figures, render_report
from femfit.report.circuits import at_currents, several_circuits
from femfit.report.content import ReportContent, strongest_point
from support.bearing import ENTRY, Symmetric, table_of, table_with_hall
from support.page import Page

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


def test_the_force_is_odd_in_the_differential_current(several):
    middle = len(several.distance_m) // 2
    force = several.grid.force[:, middle]
    np.testing.assert_allclose(several.along, [1.0, -1.0], rtol=1e-3)
    np.testing.assert_allclose(force, -force[::-1], atol=1e-3 * np.abs(force).max())  # of the fit


def test_stiffness_and_force_per_current_are_those_of_the_closed_form(several):
    middle = len(several.distance_m) // 2
    np.testing.assert_allclose(several.bias_A, [1.0, 1.0])  # half of 2 A: without a magnet nothing holds at 0 A
    np.testing.assert_allclose(several.holding_A[middle], several.bias_A, rtol=1e-3)
    per_current = TRUTH.force_per_current(1.0)
    np.testing.assert_allclose(several.force_per_A[middle], [per_current, -per_current], rtol=5e-3)
    assert several.stiffness_N_per_m[middle] == pytest.approx(TRUTH.stiffness(1.0), rel=0.02)  # a second derivative
    own = TRUTH.AREA / (0.5 * TRUTH.GAP + TRUTH.PATH)
    assert several.coupling[middle] == pytest.approx(1e-3 / own, rel=5e-3)


def test_the_currents_that_hold_balance_the_weight(fit):
    model = fit_model(table_of(TRUTH)).model  # it stands: 4.9 N pull it down
    several = several_circuits(model)
    force = model.magnetics.force(several.distance_m, several.holding_A)
    np.testing.assert_allclose(force, -9.81 * 0.5, rtol=1e-8)


def test_one_circuit_has_no_such_chapter(levitation_model):
    assert several_circuits(levitation_model) is None


def test_the_page_names_each_circuit(table, fit, tmp_path):
    (tmp_path / "bearing.toml").write_text(starter_text("bearing"))
    actuator = read_actuator(tmp_path / "bearing.toml")
    content = ReportContent(fit.model, actuator, table, fit)
    page = Page(render_report(content, draw_figures(content, lambda *_: (None, "no picture"))))
    assert "The circuits together" in page.text
    assert "lower −2 to 2 A and upper −2 to 2 A" in page.text
    assert strongest_point(actuator) == (0.2e-3, (2.0, 2.0))
    assert at_currents((2.0, -1.0), ("lower", "upper")) == "lower 2 A and upper −1 A"


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


def test_audit_and_report_say_of_a_hall_element_at_which_currents_it_clips_and_what_each_gives():
    clipped = table_with_hall(TRUTH, FLOATING, output_max_V=4.45)  # 39 mT, without current from 0.483 mm on
    fit = fit_model(clipped)
    (said,) = (one for one in audit_model(fit.model).findings if one.code == "hall_range")
    where = "clipped at 4.45 V from 0.485 to 0.800 mm at 0 A and 0 A"
    assert where in said.sentence
    content = ReportContent(fit.model, sweep=clipped, fit=fit)
    page = Page(render_report(content, draw_figures(content, lambda *_: (None, "no picture"))))
    assert where in page.text
    assert "lower gives 4.00 mT/A" in page.text
    assert "upper gives −3.00 mT/A" in page.text
