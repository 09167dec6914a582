"""Pages as a reader's browser gets them: their structure, and in snapshots what they say of devices and verdicts."""

import base64
import re
from dataclasses import dataclass, replace

import numpy as np
import pytest

import femfit
from femfit.audit.audit_model import audit_model
from femfit.core.errors import FemfitError, RunDirectoryError
from femfit.device.electrics import AccelerationSensor, CurrentSensor, PositionSensor
from femfit.device.load import read_actuator, starter_text
from femfit.device.mechanics import Stop
from femfit.fit.build import fit_model
from femfit.identify.add_effects import add_effects
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.suggest import Suggestion
from femfit.report.actuator_report import draw_figures, render_report
from femfit.report.bench_report import render_diagnosis
from femfit.report.page import ReportContent, write_page
from femfit.tables.measurement import CHANNELS
from support.bearing import ENTRY, Symmetric, table_with_hall
from support.campaign import campaign, hidden, ripple, rising
from support.page import Page
from support.snapshot import NUMBER, check_snapshot

PNG = b"\x89PNG\r\n\x1a\n" + b"\0" * 16


def sentences(page):
    return re.split(r"(?<=[.:;?]) ", page.text)


def check_page(name, page, renew, base=None):
    """Every sentence of a page, or those that another page has not, with those that only the other one has."""
    assert not re.search(r"\bnan\b|NaN", page.text)
    said, others = sentences(page), sentences(base) if base else []
    lines = [line for line in said if line not in others] + [f"NOT: {line}" for line in others if line not in said]
    check_snapshot(f"page-{name}", "\n".join(lines), renew=renew)


def check_new_words(name, page, base, renew):
    """The sentences of a page that another page has not, whatever their numbers are."""
    others = {NUMBER.sub("#", line) for line in sentences(base)}
    lines = [line for line in sentences(page) if NUMBER.sub("#", line) not in others]
    check_snapshot(f"page-{name}", "\n".join(lines), renew=renew)


def check_loads_nothing(page):
    assert all(uri.startswith("data:image/") for uri in page.loads)
    assert not re.search(r"url\(|@import|https?://", page.source)


def check_pictures(page):
    for name, image in page.images.items():
        kind, content = image["src"].split(";base64,")
        picture = base64.b64decode(content)
        assert len(image["alt"]) > 20, name
        assert len(picture) < 400_000, name  # a gouraud field as SVG has 40 MB
        assert kind.endswith("png") or b"<path" in picture


@dataclass(frozen=True)
class Reported:
    """What a page is of, and the page."""

    content: ReportContent
    page: Page


@pytest.fixture(scope="module")
def reported(rig_content, plunger_content):
    """The reports of both, with every law ranked and a picture that nobody looks at."""
    every = {}
    for name, content in (("rig", rig_content), ("plunger", plunger_content)):
        ranked = replace(content, fit=fit_model(content.sweep, law="all"))
        figures = draw_figures(ranked, lambda *_: (PNG, ""))
        every[name] = Reported(ranked, Page(render_report(ranked, figures)))
    return every


@pytest.fixture(scope="module")
def rig_page(reported):
    return reported["rig"].page


def test_the_report_is_one_file_below_3_megabytes_that_loads_nothing(rig_page, tmp_path):
    file = write_page(rig_page.source, tmp_path / "new" / "report.html")
    assert [file.name for file in file.parent.iterdir()] == ["report.html"]
    assert file.stat().st_size < 3_000_000
    check_loads_nothing(rig_page)


def test_the_chapters_follow_the_kind_of_actuator(rig_page, reported):
    plunger_page = reported["plunger"].page
    chapters = ["actuator", "stroke", "heat", "model", "laws", "limits", "provenance"]
    assert [name for name in plunger_page.ids if not name.startswith("figure-")] == chapters
    assert {"field", "sensor", "loop"} <= set(rig_page.ids)
    assert not {"hall", "steps-pid", "field", "cutaway"} & set(plunger_page.images)
    assert "magnet" not in plunger_page.text


def test_every_picture_says_what_it_shows_and_is_lines_not_megabytes(rig_page):
    assert {"cutaway", "actuator", "stroke", "field", "force-curves", "hall"} <= set(rig_page.images)
    check_pictures(rig_page)


@pytest.mark.parametrize("name", ["rig", "plunger"])
def test_a_page_says_what_it_said_and_speaks_of_no_paper(name, reported, renew):
    page = reported[name].page
    assert not re.search(r"\bpaper|Table 6|Figure 1|unknown|None", page.text)
    check_page(name, page, renew)


SENSORS = (
    AccelerationSensor(name="mems", noise=0.5, minimum=-800.0, maximum=800.0, bits=14),
    PositionSensor(name="laser", noise=4e-3, distances_m=(0.0, 1.0), readings=(0.5, 800.5), delay_s=3e-4),
    CurrentSensor(name="shunt", circuit="coil"),
)
MARKED_UP = "<script>alert(1)</script> & more"
# Parts of a model, of an actuator and of a report that take the place of others
VARIANTS = {
    "rig-clipped": lambda model, _: {"model": {"sensor": replace(model.sensor, sensitivity_V_per_T=500.0)}},
    # a supply whose current lies beyond the sweep
    "rig-strong": lambda model, _: {"model": {"circuits": (replace(model.circuit, voltage_max_V=40.0),)}},
    "rig-lost": lambda _, lost_study: {"study": lost_study},
    "rig-awkward": lambda *_: {
        "actuator": {"name": "mine", "description": MARKED_UP},
        "study": None,
        "no_study": "No current holds it.",
    },
    "plunger-stops": lambda model, _: {
        "model": {"motion": replace(model.motion, near_stop=Stop(0.02), far_stop=Stop(0.04))}
    },
    "plunger-sensors": lambda *_: {"actuator": {"sensors": SENSORS}},
}


@pytest.mark.parametrize("name", VARIANTS)
def test_what_differs_is_said_otherwise(name, reported, lost_study, renew):
    content, base = vars(reported[name.partition("-")[0]]).values()
    parts = VARIANTS[name](content.model, lost_study)
    inner = {key: replace(getattr(content, key), **part) for key, part in parts.items() if isinstance(part, dict)}
    figures = {image: one["src"] for image, one in base.images.items()}
    check_page(name, Page(render_report(replace(content, **parts | inner), figures)), renew, base)


def test_a_report_on_a_model_alone_has_what_a_model_knows(rig_content, tmp_path):
    femfit.write_model(rig_content.model, tmp_path / "model.json")
    written = femfit.write_report(str(tmp_path / "model.json"), str(tmp_path / "model.html"))
    page = Page(written.read_text(encoding="utf-8"))
    assert {"stroke", "sensor", "model", "limits"} <= set(page.ids)
    assert "actuator" not in page.ids
    assert "stroke" in page.images


@pytest.mark.nightly
def test_a_report_on_two_circuits_names_each(tmp_path, renew):
    clipped_at = table_with_hall(Symmetric(), {**ENTRY, "mechanics": {"gravity_m_s2": 0.0}}, output_max_V=4.45)
    fit = fit_model(clipped_at)  # 39 mT, without current from 0.483 mm on
    (tmp_path / "bearing.toml").write_text(starter_text("bearing"))
    content = ReportContent(fit.model, read_actuator(tmp_path / "bearing.toml"), clipped_at, fit)
    page = Page(render_report(content, draw_figures(content, lambda *_: (None, "no EGL here"))))
    (clips,) = (one for one in audit_model(fit.model).findings if one.code == "hall_range")
    # 22 to 58 mT over the distance, symmetric in the currents: above 39 mT in 19/36, at 2 A and -2 A from 0.25 mm on
    assert clips.recomputed == pytest.approx(19.0 / 36.0, abs=5e-3)
    assert "clipped at 4.45 V from 0.254 to 0.800 mm at some currents" in clips.sentence
    check_page("bearing", page, renew)


def test_what_is_no_result_and_a_report_that_grows_too_large_are_refused_and_nothing_is_written(tmp_path):
    with pytest.raises(FemfitError, match="instead received int"):
        femfit.write_report(3, tmp_path / "x.html")
    with pytest.raises(RunDirectoryError, match=r"below 3 MB; it has 3\.00 MB"):
        write_page("x" * 3_000_001, tmp_path / "report.html")
    assert list(tmp_path.iterdir()) == []


SIZE = {"distances": 7, "currents": 5}
HALL = hidden("hall_offset", offset_V=0.02)


def rising_once(every):
    return lambda model: (model, rising(campaign(model, 65, [HALL], runs=1, **SIZE), every))


def force_alone(model):
    table = campaign(model, 63, [hidden("force_offset", offset=0.03)], **SIZE)
    given = tuple(name for name in table.given if name not in CHANNELS or name == "force_N")
    unread = {name: np.nan for name in CHANNELS if name != "force_N"}
    return model, replace(table, rows=table.rows.assign(**unread), given=given)


def rough(model):
    model = replace(model, misfit=replace(model.misfit, force_rms_N=0.01), provenance={})
    return model, campaign(model, 69, [hidden("force_gain", gain_error=0.03)], **SIZE)


DIAGNOSES = {
    "nothing-missing": (lambda model: (model, campaign(model, 62, **SIZE)), "nothing_missing"),
    "class": (force_alone, "named"),
    "unexplained": (lambda model: (model, campaign(model, 64, change=ripple("hall_V", 20e-3), **SIZE)), "unexplained"),
    "compare-only": (rising_once(5), "compare_only"),
    "guessed-noise": (rising_once(1), None),
    "own-misfit": (rough, None),
}


@pytest.fixture(scope="module")
def advised(levitation_model):
    table = campaign(levitation_model, 61, [HALL], runs=4, **SIZE)
    table = replace(table, source="rig.csv", test_object="Rig <3>", notes="warm")
    found = diagnose(levitation_model, table)
    hashes = (("rig.csv", "ab" * 32),)
    return found, table, Page(render_diagnosis(found, data=table, hashes=hashes))


def test_the_page_on_a_diagnosis_begins_with_measured_points_and_loads_nothing(advised, renew):
    found, _, page = advised
    curves = {f"curves-{name}" for name in found.observations.channels}
    assert next(iter(page.images)).startswith("curves-")
    assert set(page.images) == curves | {"misfit-maps"}
    assert all(link.removeprefix("#") in page.ids for link in page.links)
    check_loads_nothing(page)
    check_pictures(page)
    assert len(page.source) < 3_000_000
    check_page("diagnosis", page, renew)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.nightly] * (name == "unexplained")) for name in DIAGNOSES]
)
def test_every_verdict_has_its_page(name, levitation_model, advised, renew):
    make, verdict = DIAGNOSES[name]
    model, table = make(levitation_model)
    found = diagnose(model, table)
    page = Page(render_diagnosis(found, data=table))
    assert verdict in {None, found.verdict}
    assert ("fall" in page.ids) == bool(found.missing)
    channels = [channel for channel in CHANNELS if channel in table.given]
    readings = int(table.rows[channels].notna().to_numpy().sum())
    assert f"{readings} readings" in page.text.replace(",", "")
    check_new_words(f"diagnosis-{name}", page, advised[2], renew)
    if name == "class":
        first, second = found.missing[0].members[:2]
        advice = Suggestion("Read the Hall output as well.", 60.0, ((first, second, 8.0),), ())
        told = Page(render_diagnosis(found, table, suggestions=(advice,)))
        check_page("diagnosis-class-advised", told, renew, page)


@pytest.mark.nightly
@pytest.mark.usefixtures("undrawn")
def test_what_was_added_has_a_page(levitation_model, advised, tmp_path, renew):
    result = add_effects(levitation_model, advised[1], "hall_offset")
    page = Page(femfit.write_report(result, tmp_path / "added.html").read_text(encoding="utf-8"))
    check_page("added-hall_offset", page, renew)


@pytest.mark.usefixtures("undrawn")
def test_a_comparison_has_a_page_that_begins_with_its_curves(levitation_model, tmp_path, renew):
    table = campaign(levitation_model, 65, distances=4, currents=3)
    file = femfit.write_report(femfit.compare(levitation_model, table), tmp_path / "comparison.html")
    page = Page(file.read_text(encoding="utf-8"))
    assert next(iter(page.images)).startswith("curves-")
    check_page("comparison", page, renew)
