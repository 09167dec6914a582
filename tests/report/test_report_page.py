"""The page as a reader's browser gets it."""

import base64
import re
from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import RunDirectoryError
from femfit.fit.build import fit_model
from femfit.report import html
from femfit.report.html import render_report, write_report
from femfit.report.offscreen import OffScreenPicture
from femfit.report.section import DataTable
from femfit.report.section_actuator import actuator_section
from femfit.report.section_loop import loop_section
from femfit.report.summary import summary
from support.page import Page

PNG = b"\x89PNG\r\n\x1a\n" + b"\0" * 16

PAPER_FIGURES = {
    6: "force-map",
    7: "force-curves",
    8: "residual-sums",
    9: "law-curves",
    10: "coefficient-functions",
    11: "hall",
}
"""Figures of the paper and the pictures that show the same here."""


def drawn(_actuator, _sample):
    return OffScreenPicture(PNG, "a test")


def not_drawn(_actuator, _sample):
    return OffScreenPicture(None, "no EGL here")


@pytest.fixture(scope="module")
def rig_file(rig_content, tmp_path_factory):
    return write_report(rig_content, tmp_path_factory.mktemp("run") / "new" / "report.html", drawn)


@pytest.fixture(scope="module")
def rig_page(rig_file):
    return Page(rig_file.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def other_page(rig_content):
    """Another actuator's, with an awkward description, without a loop, where pyvista cannot draw."""
    actuator = replace(rig_content.actuator, name="mine", description="<script>alert(1)</script> & more")
    content = replace(rig_content, actuator=actuator, study=None, no_study="No current holds it.")
    return Page(render_report(content, not_drawn))


@pytest.fixture(scope="module")
def plunger_page(plunger_content):
    return Page(render_report(plunger_content, drawn))


def test_the_report_is_one_file_below_3_megabytes(rig_file):
    assert [file.name for file in rig_file.parent.iterdir()] == ["report.html"]
    assert rig_file.stat().st_size < 3_000_000


def test_nothing_is_loaded_from_outside(rig_file, rig_page):
    assert all(uri.startswith("data:image/") for uri in rig_page.loads)
    assert all(link.startswith("#") for link in rig_page.links)
    assert not re.search(r"url\(|@import|https?://", rig_file.read_text(encoding="utf-8"))


def test_links_lead_to_sections_and_no_identifier_is_twice(rig_page):
    assert {link.removeprefix("#") for link in rig_page.links} <= set(rig_page.ids)
    assert len(set(rig_page.ids)) == len(rig_page.ids)


@pytest.mark.parametrize("number", PAPER_FIGURES)
def test_each_figure_of_the_paper_is_there(rig_page, number):
    assert rig_page.images[PAPER_FIGURES[number]]["src"].startswith("data:image/svg+xml;base64,")
    assert re.search(rf"Figure {number} of the paper\b", rig_page.text)


def test_every_picture_says_what_it_shows(rig_page):
    assert {"cutaway", "actuator", "field", "accuracy", "exponents", "ranking", "residuals"} <= set(rig_page.images)
    assert all(len(image["alt"]) > 20 for image in rig_page.images.values())


def test_pictures_are_lines_not_megabytes(rig_page):
    for name, image in rig_page.images.items():
        kind, content = image["src"].split(";base64,")
        size = len(base64.b64decode(content))
        assert size < 400_000, name  # a gouraud field as SVG has 40 MB
        if kind.endswith("svg+xml"):
            assert b"<path" in base64.b64decode(content)


def test_numbers_come_with_their_unit_from_the_data(rig_page, rig_content):
    rows = rig_content.fit.rows
    wanted = [
        "4.35 g, 42.7 mN",  # mass and weight
        "308 turns, wire 0.49 mm",
        "2.69 Ω",
        "16.20 mH",  # the table's inductance, the same at every distance
        "d = 22 mm and i = 0.32 A",
        f"{1e3 * rows.force.max():.0f} mN",
        "5.25 s",
        "ab" * 32,
        "c0ffee" * 10,
    ]
    assert [text for text in wanted if text not in rig_page.text] == []


def test_the_filters_are_compared_by_their_numbers(rig_page):
    assert "At rest their noise differs by 2.0 % at most." in rig_page.text
    assert "EKF, body at 22 mm believed at 30 mm, 2 of 2 held" in rig_page.text


def test_another_actuator_is_not_compared_with_the_paper(rig_content, other_page):
    assert "The paper has a =" not in other_page.text
    mine = replace(rig_content, actuator=replace(rig_content.actuator, name="mine"))
    tables = [block for block in loop_section(mine).blocks if isinstance(block, DataTable)]
    assert tables[0].header == ("measurement", "backstepping (µm)", "PID (µm)")


def test_an_actuator_without_magnet_and_hall_element_is_told_so(plunger_page):
    assert "the force grows with the square of the current" in plunger_page.text
    assert "no Hall element, so there is no characteristic to show" in plunger_page.text
    assert "The loop was not closed: this actuator has no Hall element" in plunger_page.text
    assert not {"hall", "steps-pid", "filters", "field", "cutaway"} & set(plunger_page.images)
    assert "NaN" not in plunger_page.text
    assert "unknown" not in plunger_page.text


@pytest.mark.parametrize(
    ("at_rest", "words"),
    [
        (lambda d: 1.0 / d, "It is attracted without current already; the current adds to that force."),
        (lambda d: -1.0 / d, "It is pushed away without current already; the current adds to that force."),
        (
            lambda d: d - 0.03,
            "It is attracted or, at other distances, pushed away without current already; the current",
        ),
        (lambda d: 0.0 * d, "Without current there is no force; with the current the force changes its sign."),
    ],
)
def test_what_a_magnet_does_without_current_is_said_of_its_own_forces(rig_content, at_rest, words):
    rows = rig_content.fit.rows
    force = at_rest(rows.distance) + (rows.distance - 0.02) * rows.current
    content = replace(rig_content, fit=replace(rig_content.fit, rows=replace(rows, force=force)))
    assert words in str(actuator_section(content, 0.022, None).blocks[0])


def test_a_loop_that_lost_every_run_is_told_without_false_numbers(rig_content, lost_study):
    content = replace(rig_content, study=lost_study)
    words = " ".join(map(str, (*summary(content), *loop_section(content).blocks)))
    assert "4 of 4 runs lost" in words
    assert "Every run of the reference steps was lost" in words
    assert "backstepping, last at 22 mm and 0.4 A" in words
    assert not re.search(r"\bnan\b", words)
    assert len(loop_section(content).blocks) == 2


def test_runs_lost_in_part_are_counted_beside_the_means(rig_content, partly_lost_study):
    words = " ".join(map(str, loop_section(replace(rig_content, study=partly_lost_study)).blocks))
    assert "(1 of 2 runs lost)" in words


def test_the_error_beside_a_change_of_the_forces_sign_is_measured_by_the_force_nearby(rig_content):
    rows = rig_content.sweep.rows
    near = rows["force_N"][(rows["current_A"] == 0.0) & (rows["distance_m"] > 0.02)].iloc[0]
    table = replace(rig_content.sweep, rows=rows.assign(force_N=rows["force_N"] - near * 1.0001))
    content = replace(rig_content, sweep=table, fit=fit_model(table))
    # 2 uN over the force that is left there, 4 uN, would be 50 %; the neighbours' forces are thousands of times larger
    assert "estimated error at most 0.0" in str(summary(content)[0])


def test_filters_without_a_direct_measurement_are_told_so_and_drawn_without_it(rig_content):
    known = rig_content.study
    none = np.full_like(known.series[0].direct_m, np.nan)
    study = replace(
        known,
        no_direct="The Hall voltage turns at 38 mm.",
        steps=tuple(row for row in known.steps if row.measurement != "direct"),
        holds=tuple(replace(row, direct_rms_m=np.nan, ratio=np.nan) for row in known.holds),
        faults=tuple(row for row in known.faults if row.experiment.observer != "direct"),
        spectra=(),
        series=tuple(replace(one, direct_m=none) for one in known.series),
    )
    page = Page(render_report(replace(rig_content, study=study), drawn))
    words = page.text
    assert "The filters stand alone: The Hall voltage turns at 38 mm." in words
    assert "better at rest than the direct measurement" not in words
    assert not re.search(r"\bnan\b", words)


def test_the_reason_of_a_missing_loop_is_the_errors(other_page):
    assert "The loop was not closed: No current holds it." in other_page.text


def test_without_pyvista_the_map_remains_and_the_reason_is_said(other_page):
    assert "cutaway" not in other_page.images
    assert "field" in other_page.images
    assert "There is no three-dimensional view: no EGL here." in other_page.text


def test_names_from_the_file_cannot_write_markup(other_page):
    assert "<script>alert(1)</script> & more" in other_page.text


def test_a_report_that_grows_too_large_is_refused_and_nothing_is_written(rig_content, tmp_path, monkeypatch):
    monkeypatch.setattr(html, "render_report", lambda _content, _draw: "x" * 3_000_001)
    with pytest.raises(RunDirectoryError, match=r"below 3 MB; it has 3\.00 MB"):
        write_report(rig_content, tmp_path / "report.html", drawn)
    assert list(tmp_path.iterdir()) == []
