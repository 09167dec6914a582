"""The report of a diagnosis as a reader's browser gets it, for every verdict."""

import re
from dataclasses import replace

import numpy as np
import pytest

import femfit
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.decision.diagnosis_text import certainty_sentence, verdict_sentence
from femfit.identify.experiments.suggest import Suggestion, suggest
from femfit.identify.readings.bench import bench_observations
from femfit.identify.refit.add_effects import add_effects
from femfit.report.bench_report import render_diagnosis
from femfit.report.misfit_figures import settings_figure
from femfit.report.page import write_page
from femfit.tables.measurement import CHANNELS
from support.campaign import NOISE, campaign
from support.page import Page

SIZE = {"distances": 7, "currents": 5}


def hidden(name, **values):
    effect = effect_by_name(name)
    return AddedEffect(effect, effect.null() | values)


HALL = hidden("hall_offset", offset_V=0.02)


def page_of(model, table, advised=False, **more):
    diagnosis = diagnose(model, table, bootstrap=0)
    advice = suggest(model, table, diagnosis).suggestions if advised else ()
    content = {"data": table, "suggestions": advice, **more}
    return diagnosis, content, Page(render_diagnosis(diagnosis, **content))


@pytest.fixture(scope="module")
def advised(levitation_model):
    table = replace(
        campaign(levitation_model, 61, [HALL], runs=4, **SIZE), source="rig.csv", test_object="Rig <3>", notes="warm"
    )
    return page_of(levitation_model, table, advised=True, hashes=(("rig.csv", "ab" * 32),))


def others(page):
    """Pictures but those of the points on the curves."""
    return {name for name in page.images if not name.startswith("curves-")}


def test_the_first_picture_is_of_measured_points_on_the_models_curves(advised):
    diagnosis, _, page = advised
    first = next(iter(page.images))
    assert first.startswith("curves-")
    assert {f"curves-{name}" for name in diagnosis.observations.channels} <= set(page.images)


def test_the_page_reads_as_an_argument_in_order(advised):
    _, _, page = advised
    places = [page.text.index(f"{k}. {title}") for k, title in enumerate(
        ("Measured points on the model's curves", "What was measured",
         "Where the model fails", "What would explain it", "What else could",
         "What to measure next", "How far the error fell", "Where the numbers come from"), start=1)]  # fmt: skip
    assert places == sorted(places)
    assert others(page) == {"settings", "misfit-maps", "ranking-effects", "waterfall", "after-maps"}


def test_the_page_holds_everything_and_loads_nothing(advised, tmp_path):
    _, _, page = advised
    assert all(uri.startswith("data:image/") for uri in page.loads)
    assert all(link.removeprefix("#") in page.ids for link in page.links)
    assert all(image["alt"] for image in page.images.values())
    file = write_page(page.source, tmp_path / "new" / "report.html")
    assert file.stat().st_size < 3_000_000
    assert not re.search(r"url\(|@import|https?://", file.read_text(encoding="utf-8"))


def test_what_the_user_wrote_is_escaped(advised):
    _, _, page = advised
    assert "Rig <3>" in page.text


def test_what_was_added_is_a_page_of_its_own(levitation_model, advised, tmp_path):
    _, content, _ = advised
    result = add_effects(levitation_model, content["data"], ["hall_offset"])
    file = femfit.write_report(result, tmp_path / "added.html")
    page = Page(file.read_text(encoding="utf-8"))
    assert {"waterfall", "after-maps", "curves-hall_V"} <= set(page.images)
    assert "hall_offset was added to the model" in page.text
    assert str(result.fall.channels[0]) in page.text


def test_the_noise_and_its_source_stand_beside_each_channel(advised):
    diagnosis, _, page = advised
    assert "known from" in page.text
    for sigma in diagnosis.noise_floor.values():
        assert sigma > 0.0
    assert page.text.count("repeats") >= len(diagnosis.noise_floor)


def test_the_fall_of_the_error_is_said_in_one_way(advised):
    diagnosis, _, page = advised
    worst = max(diagnosis.error_fall.channels, key=lambda one: one.before_over_noise)
    assert str(worst) in page.text


@pytest.mark.usefixtures("undrawn")
def test_nothing_missing_is_said_without_a_ranking_or_a_waterfall(levitation_model):
    diagnosis, _, page = page_of(levitation_model, campaign(levitation_model, 62, **SIZE))
    assert verdict_sentence(diagnosis) in page.text
    assert diagnosis.verdict == "nothing_missing"
    assert others(page) == {"settings", "misfit-maps"}
    assert "nine times in ten" in page.text


@pytest.mark.usefixtures("undrawn")
def test_a_class_of_several_is_said_first_and_what_splits_it_follows(levitation_model):
    table = campaign(levitation_model, 63, [hidden("force_offset", offset=0.03)], **SIZE)
    given = tuple(name for name in table.given if name not in CHANNELS or name == "force_N")
    unread = {name: np.nan for name in CHANNELS if name != "force_N"}
    diagnosis, _, page = page_of(levitation_model, replace(table, rows=table.rows.assign(**unread), given=given))
    (named,) = diagnosis.missing
    assert len(named.members) > 1
    assert certainty_sentence(diagnosis) in page.text  # page and command say the same
    assert "could as well be" in page.text
    assert "femfit add" in page.text
    first, second = named.members[:2]
    advice = Suggestion("Read the Hall output as well.", 60.0, ((first, second, 8.0),), ())
    advised = Page(render_diagnosis(diagnosis, table, suggestions=(advice,)))
    assert advised.text.count("Read the Hall output as well.") == 2
    assert f"{first} from {second} by 8.0 σ" in advised.text
    silent = Page(render_diagnosis(diagnosis, table))
    assert "No measurement that femfit knows" in silent.text


@pytest.mark.usefixtures("undrawn")
def test_something_unknown_is_called_unknown_and_its_place_is_shown(levitation_model):
    def ripple(readings, rows):
        wave = 20e-3 * np.sin(2.0 * np.pi * rows["distance_m"].to_numpy() / 9e-3)
        return readings | {"hall_V": readings["hall_V"] + wave}

    diagnosis, _, page = page_of(levitation_model, campaign(levitation_model, 64, change=ripple, **SIZE))
    assert diagnosis.verdict == "unexplained"
    assert verdict_sentence(diagnosis) in page.text
    assert "waterfall" not in page.images
    assert "ranking-effects" in page.images


@pytest.mark.usefixtures("undrawn")
def test_without_a_noise_floor_the_page_says_what_to_measure(levitation_model):
    table = campaign(levitation_model, 65, [HALL], runs=1, **SIZE)
    rising = replace(table, rows=table.rows[table.rows["branch"] > 0].reset_index(drop=True))
    scattered = replace(rising, rows=rising.rows.iloc[::5].reset_index(drop=True))
    diagnosis, _, page = page_of(levitation_model, scattered)
    assert diagnosis.verdict == "compare_only"
    assert "at least twice" in page.text
    assert others(page) == {"settings", "misfit-maps"}


@pytest.mark.usefixtures("undrawn")
def test_a_guessed_noise_is_said(levitation_model):
    table = campaign(levitation_model, 65, [HALL], runs=1, **SIZE)
    rising = replace(table, rows=table.rows[table.rows["branch"] > 0].reset_index(drop=True))
    diagnosis, _, page = page_of(levitation_model, rising)
    (guessed,) = [one for one in diagnosis.findings if one.code == "guessed-noise"]
    assert str(guessed) in page.text


@pytest.mark.usefixtures("undrawn")
def test_mounts_are_spoken_of_only_where_the_data_tell_them(levitation_model):
    table = campaign(levitation_model, 66, **SIZE)
    _, _, page = page_of(levitation_model, table)
    assert "3 runs and 3 mounts" in page.text
    assert "Put back by hand" in page.text
    _, _, page = page_of(levitation_model, replace(table, given=tuple(name for name in table.given if name != "mount")))
    assert "mount" not in page.text.split("Where the model fails")[1]
    assert "In each run the recorded distance is right to within" in page.text


@pytest.mark.usefixtures("undrawn")
def test_a_models_own_misfit_comes_with_what_to_sweep(levitation_model):
    misfit = replace(levitation_model.misfit, force_rms_N=0.01)
    model = replace(levitation_model, misfit=misfit, provenance={})
    diagnosis, _, page = page_of(model, campaign(model, 69, [hidden("force_gain", gain_error=0.03)], **SIZE))
    assert diagnosis.own_misfit
    assert verdict_sentence(diagnosis) in page.text
    assert "Sweep at more distances and currents" in page.text
    assert "nine times in ten beyond the model's own misfit" in page.text


@pytest.mark.usefixtures("undrawn")
def test_a_distance_without_scatter_is_not_said_to_be_right_to_0_m(levitation_model):
    table = campaign(levitation_model, 66, runs=1, mount_m=0.0, **SIZE)
    once = replace(table, given=tuple(name for name in table.given if name not in ("mount", "run")))
    _, _, page = page_of(levitation_model, replace(once, declared_noise=NOISE))
    assert "to within 0 m" not in page.text
    assert "The distance is taken as recorded" in page.text


@pytest.mark.usefixtures("undrawn")
def test_readings_rows_settings_and_runs_are_counted_as_the_table_has_them(levitation_model):
    table = campaign(levitation_model, 68, **SIZE)
    _, _, page = page_of(levitation_model, table)
    channels = [name for name in CHANNELS if name in table.given]
    readings = int(table.rows[channels].notna().to_numpy().sum())
    settings = len(table.rows[["distance_m", "current_A", "branch"]].drop_duplicates())
    assert settings < len(table.rows)
    said = page.text.replace(",", "")
    assert f"{readings} readings of 4 channels in {len(table.rows)} rows at {settings} settings in 3 runs" in said


def test_the_legend_of_the_temperatures_covers_no_curve(levitation_model):
    figure = settings_figure(bench_observations(levitation_model, campaign(levitation_model, 67, **SIZE)))
    assert all(axes.get_legend() is None for axes in figure.axes)
    assert [text.get_text() for text in figure.legends[1].get_texts()] == ["coil", "magnet"]
