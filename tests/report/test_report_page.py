"""The page on an actuator as a reader's browser gets it."""

import base64
import re
from dataclasses import replace

import numpy as np
import pytest

import femfit
from femfit.audit.audit_model import audit_model
from femfit.core.errors import FemfitError, RunDirectoryError
from femfit.device.mechanics import Stop
from femfit.device.sensors import AccelerationSensor, CurrentSensor, PositionSensor
from femfit.fit.build import fit_model
from femfit.report.actuator_report import draw_figures, render_report
from femfit.report.numbers import percent
from femfit.report.page import write_page
from support.page import Page

PNG = b"\x89PNG\r\n\x1a\n" + b"\0" * 16


def drawn(_actuator, _sample):
    return PNG, ""


def not_drawn(_actuator, _sample):
    return None, "no EGL here"


def page_of(content, draw=drawn, **more):
    return Page(render_report(content, draw_figures(content, draw, **more)))


@pytest.fixture(scope="module")
def begun_content(rig_content):
    """The same before the laws are ranked and the loop is closed."""
    return replace(rig_content, fit=fit_model(rig_content.sweep), study=None, unfinished=True)


@pytest.fixture(scope="module")
def begun_figures(begun_content):
    return draw_figures(begun_content, drawn)


@pytest.fixture(scope="module")
def rig_figures(rig_content, begun_figures):
    return draw_figures(rig_content, drawn, begun_figures)


@pytest.fixture(scope="module")
def rig_page(rig_content, rig_figures):
    return Page(render_report(rig_content, rig_figures))


@pytest.fixture(scope="module")
def other_page(rig_content, rig_figures):
    """Another actuator's, with an awkward description, without a loop, where pyvista cannot draw."""
    actuator = replace(rig_content.actuator, name="mine", description="<script>alert(1)</script> & more")
    content = replace(rig_content, actuator=actuator, study=None, no_study="No current holds it.")
    kept = {name: uri for name, uri in rig_figures.items() if "cut" not in name}
    return page_of(content, not_drawn, drawn=kept)


@pytest.fixture(scope="module")
def plunger_page(plunger_content):
    return page_of(plunger_content)


def test_the_report_is_one_file_below_3_megabytes_that_loads_nothing(rig_content, rig_figures, tmp_path):
    file = write_page(render_report(rig_content, rig_figures), tmp_path / "new" / "report.html")
    assert [file.name for file in file.parent.iterdir()] == ["report.html"]
    assert file.stat().st_size < 3_000_000
    page = Page(file.read_text(encoding="utf-8"))
    assert all(uri.startswith("data:image/") for uri in page.loads)
    assert all(link.startswith("#") for link in page.links)
    assert not re.search(r"url\(|@import|https?://", file.read_text(encoding="utf-8"))


def test_links_lead_to_chapters_and_no_identifier_is_twice(rig_page):
    assert {link.removeprefix("#") for link in rig_page.links} <= set(rig_page.ids)
    assert len(set(rig_page.ids)) == len(rig_page.ids)


def test_the_chapters_follow_the_kind_of_actuator(rig_page, plunger_page):
    both = ["actuator", "stroke", "coil", "model", "laws", "limits", "provenance"]
    assert [name for name in plunger_page.ids if not name.startswith("figure-")] == [*both[:3], "heat", *both[3:]]
    assert {"field", "sensor", "loop"} <= set(rig_page.ids)
    assert not {"hall", "steps-pid", "field", "cutaway"} & set(plunger_page.images)
    assert "magnet" not in plunger_page.text


def test_the_report_says_how_warm_winding_and_iron_become(plunger_page, plunger_content):
    heat = plunger_content.heat
    for line in str(heat).splitlines():
        assert line in plunger_page.text
    for name in heat.names:
        assert name in plunger_page.text.partition("The parts at the largest current that may last")[2]


def test_without_a_stop_no_force_is_called_the_holding_force(plunger_page, rig_page):
    assert "The force at the shortest distance of the sweep, 15 mm, is" in plunger_page.text
    assert "holding force" not in rig_page.text


def test_the_holding_force_is_that_on_the_stop(plunger_content):
    motion = replace(plunger_content.model.motion, near_stop=Stop(0.02), far_stop=Stop(0.04))
    page = page_of(replace(plunger_content, model=replace(plunger_content.model, motion=motion)))
    assert "The holding force, that on the stop at 20 mm, is" in page.text
    assert "Force over the stroke from 20 to 40 mm" in page.text
    assert "at 15 mm" not in page.text


def test_a_clipped_hall_element_is_said_on_the_page(rig_content, rig_figures):
    sensor = replace(rig_content.model.sensor, sensitivity_V_per_T=500.0)
    page = Page(render_report(replace(rig_content, model=replace(rig_content.model, sensor=sensor)), rig_figures))
    assert "Its output is clipped at 5 V from 15" in page.text


def test_every_drawn_sensor_is_listed(plunger_content):
    sensors = (
        AccelerationSensor(name="mems", noise=0.5, minimum=-800.0, maximum=800.0, bits=14),
        PositionSensor(name="laser", noise=4e-3, distances_m=(0.0, 1.0), readings=(0.5, 800.5), delay_s=3e-4),
        CurrentSensor(name="shunt", circuit="coil"),
    )
    text = page_of(replace(plunger_content, actuator=replace(plunger_content.actuator, sensors=sensors))).text
    assert "sensor mems acceleration; noise of 0.500 m/s² rms; −800 to 800 m/s²; 14 bits" in text
    assert "sensor laser distance in V; noise of 4.00 mV rms; 300 µs late" in text
    assert "sensor shunt current; its noise not known" in text


def test_every_picture_says_what_it_shows(rig_page):
    wanted = {"cutaway", "actuator", "stroke", "coil", "field", "force-curves", "force-map", "hall"}
    assert wanted <= set(rig_page.images)
    assert all(len(image["alt"]) > 20 for image in rig_page.images.values())


def test_pictures_are_lines_not_megabytes(rig_page):
    for name, image in rig_page.images.items():
        kind, content = image["src"].split(";base64,")
        size = len(base64.b64decode(content))
        assert size < 400_000, name  # a gouraud field as SVG has 40 MB
        if kind.endswith("svg+xml"):
            assert b"<path" in base64.b64decode(content)


def test_numbers_come_with_their_unit_from_the_data(rig_page, rig_content):
    wanted = [
        "4.35 g, 42.7 mN",  # mass and weight
        "308 turns, wire 0.49 mm",
        "2.69 Ω",
        "16.20 mH",  # the table's inductance, the same at every distance
        "d = 22 mm and i = 0.32 A",
        f"{1e3 * rig_content.rows.force.max():.0f} mN",
        "5.25 s",
        "ab" * 32,
        "c0ffee" * 10,
    ]
    assert [text for text in wanted if text not in rig_page.text] == []


def test_no_report_speaks_of_a_paper(rig_page, plunger_page):
    for page in (rig_page, plunger_page):
        assert not re.search(r"\bpaper|Table 6|Figure 1", page.text)


def test_no_number_is_missing_where_there_is_nothing_to_say(plunger_page):
    assert not re.search(r"\bnan\b|NaN|None|unknown", plunger_page.text)


@pytest.mark.parametrize(
    ("at_rest", "words"),
    [
        (lambda d: 1.0 / d, "is attracted without current"),
        (lambda d: -1.0 / d, "is pushed away without current"),
        (lambda d: d - 0.03, "attracted at some distances and pushed away at others"),
        (lambda d: 0.0 * d, "Without current there is no force; the force changes its sign"),
    ],
)
def test_what_a_magnet_does_without_current_is_said_of_its_own_forces(rig_content, rig_figures, at_rest, words):
    rows = rig_content.fit.rows
    force = at_rest(rows.distance) + (rows.distance - 0.02) * rows.current
    content = replace(rig_content, fit=replace(rig_content.fit, rows=replace(rows, force=force)))
    assert words in Page(render_report(content, rig_figures)).text


def test_a_loop_that_lost_every_run_is_reported_without_false_numbers(rig_content, rig_figures, lost_study):
    kept = {name: uri for name, uri in rig_figures.items() if not name.startswith(("steps", "spectrum"))}
    content = replace(rig_content, study=lost_study)
    page = page_of(content, drawn=kept)
    assert "Every run of the reference steps was lost" in page.text
    assert "backstepping, last at 22 mm and 0.4 A" in page.text
    assert not re.search(r"\bnan\b", page.text)
    assert not any(name.startswith("steps") for name in page.images)


def test_runs_lost_in_part_are_counted_beside_the_means(rig_content, rig_figures, partly_lost_study):
    page = Page(render_report(replace(rig_content, study=partly_lost_study), rig_figures))
    assert "(1 of 2 runs lost)" in page.text


def test_an_error_where_the_force_vanishes_is_a_part_of_the_largest_force(rig_content, rig_figures):
    rows = rig_content.fit.rows
    nothing = replace(rows, force=np.where(rows.current == 0.0, 1e-9, rows.force))
    content = replace(rig_content, fit=replace(rig_content.fit, rows=nothing))
    words = Page(render_report(content, rig_figures)).text
    assert f"at most {percent(2e-6 / rows.force.max())}".replace("\u00a0", " ") in words


def test_filters_without_a_direct_measurement_are_drawn_without_it(rig_content, rig_figures):
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
    kept = {name: uri for name, uri in rig_figures.items() if not name.startswith(("steps", "spectrum"))}
    page = page_of(replace(rig_content, study=study), drawn=kept)
    assert "The Hall voltage turns at 38 mm." in page.text
    assert "less noisy than the direct measurement" not in page.text
    assert not re.search(r"\bnan\b", page.text)


def test_the_reason_of_a_missing_loop_is_the_errors(other_page):
    assert "No current holds it." in other_page.text


def test_without_pyvista_the_map_remains_and_the_reason_is_said(other_page):
    assert "cutaway" not in other_page.images
    assert "field" in other_page.images
    assert "There is no three-dimensional view: no EGL here." in other_page.text


def test_a_current_beyond_the_sweep_has_no_force_at_the_supplys_voltage(rig_content, rig_figures):
    strong = replace(rig_content.model, circuits=(replace(rig_content.model.circuit, voltage_max_V=40.0),))
    page = Page(render_report(replace(rig_content, model=strong), rig_figures))
    assert "sweep to that current to know the force at 40 V" in page.text
    assert "At 40 V." not in page.text


def test_report_and_audit_say_the_same_of_the_weight(rig_content, rig_figures):
    page = Page(render_report(rig_content, rig_figures))
    (held,) = (one for one in audit_model(rig_content.model).findings if one.code == "held_range")
    said = held.sentence.rstrip(".").split("; ")
    assert said
    assert all(one in page.text for one in said if "reference" not in one)


def test_names_from_the_file_cannot_write_markup(other_page):
    assert "<script>alert(1)</script> & more" in other_page.text


def test_an_unfinished_report_can_be_read_and_is_finished_without_drawing_again(
    begun_content, begun_figures, rig_figures, rig_page
):
    page = Page(render_report(begun_content, begun_figures))
    assert "stroke" in page.images
    assert "still being simulated" in page.text
    assert all(rig_figures[name] is uri for name, uri in begun_figures.items())
    assert "ranking" in set(rig_figures) - set(begun_figures)
    assert "still being simulated" not in rig_page.text


def test_a_report_on_a_model_alone_has_what_a_model_knows(rig_content, tmp_path):
    model = tmp_path / "model.json"
    femfit.write_model(rig_content.model, model)
    page = Page(femfit.write_report(model, tmp_path / "model.html").read_text(encoding="utf-8"))
    assert {"stroke", "coil", "sensor", "model", "limits"} <= set(page.ids)
    assert "actuator" not in page.ids
    again = femfit.write_report(str(model), str(tmp_path / "again.html"))
    assert {"stroke", "coil"} <= set(Page(again.read_text(encoding="utf-8")).images)


def test_a_result_without_a_report_is_refused(tmp_path):
    with pytest.raises(FemfitError, match="instead received int"):
        femfit.write_report(3, tmp_path / "x.html")


def test_a_report_that_grows_too_large_is_refused_and_nothing_is_written(tmp_path):
    with pytest.raises(RunDirectoryError, match=r"below 3 MB; it has 3\.00 MB"):
        write_page("x" * 3_000_001, tmp_path / "report.html")
    assert list(tmp_path.iterdir()) == []
