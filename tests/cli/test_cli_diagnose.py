"""``femfit diagnose`` and ``femfit suggest`` as users type them."""

import json

import pytest

from femfit.core.errors import UsageError
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.identify.decision.campaign import considered_effects
from femfit.model.json_file import write_model
from support.campaign import NOISE, campaign
from support.command import femfit


@pytest.fixture(scope="module")
def files(levitation_model, tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    write_model(levitation_model, folder / "model.json")
    hall = AddedEffect(effect_by_name("hall_offset"), {"offset_V": 0.02})
    campaign(levitation_model, 31, [hall], distances=6, currents=5).rows.to_csv(folder / "bench.csv", index=False)
    return folder


def test_the_verdict_is_the_first_line_and_what_could_have_been_seen_comes_last(files):
    done = femfit("diagnose", files / "model.json", files / "bench.csv", "--bootstrap", 5, "--json", files / "d.json")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.split("\n")
    assert "hall_offset" in lines[0]
    assert "offset_V" not in done.stdout  # parameters are said in words, with units
    assert lines.index("These data would have shown, nine times in ten:") > 5
    assert "of 5 simulated clean campaigns" in done.stdout
    data = json.loads((files / "d.json").read_text())
    assert (data["verdict"], data["missing"][0]["name"]) == ("named", "hall_offset")
    assert data["noise_floor"]["hall_V"] == pytest.approx(NOISE["hall_V"], rel=0.3)


def test_an_excluded_effect_is_not_named_and_the_report_is_written(files):
    done = femfit(
        "diagnose", files / "model.json", files / "bench.csv", "--bootstrap", 0, "--exclude", "hall_offset",
        "--report", files / "d.html",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "Missing: hall_offset" not in done.stdout
    assert "What to measure next" in (files / "d.html").read_text(encoding="utf-8")


def test_suggest_answers_for_measured_data_and_for_a_plan(files):
    done = femfit("suggest", files / "model.json", files / "bench.csv", "--json", files / "s.json")
    assert done.returncode == 0, done.stderr
    assert "hall_offset" in json.loads((files / "s.json").read_text())["explanations"]
    (files / "plan.csv").write_text(
        "run,order,current_A,distance_m,branch,force_N\n"
        + "".join(f"1,{k},{0.2 * (k % 7)},{0.016 + 0.002 * (k // 7)},1,\n" for k in range(70))
    )
    done = femfit("suggest", files / "model.json", "--plan", files / "plan.csv")
    assert done.returncode == 0, done.stderr
    (line,) = (line for line in done.stdout.splitlines() if line.endswith(": these data lack hall_V"))
    assert "hall_offset" in line


def test_suggest_asks_for_repeats_where_no_noise_is_known(files):
    lines = (files / "bench.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    (files / "few.csv").write_text("".join(lines[:6]), encoding="utf-8")
    done = femfit("suggest", files / "model.json", files / "few.csv")
    assert done.returncode == 0, done.stderr
    assert "Measure some settings twice" in done.stdout


def test_suggest_without_data_and_plan_says_what_to_give(files):
    done = femfit("suggest", files / "model.json")
    assert done.returncode == 2
    assert "--plan" in done.stderr


def test_an_effect_to_exclude_that_the_catalogue_does_not_have_is_refused():
    with pytest.raises(UsageError, match="core_saturaton"):
        considered_effects(("core_saturaton",))
    assert "core_saturation" not in {effect.name for effect in considered_effects(("core_saturation",))}


def test_a_negative_bootstrap_is_a_mistake_in_the_command(files):
    assert femfit("diagnose", files / "model.json", files / "bench.csv", "--bootstrap", -1).returncode == 2
