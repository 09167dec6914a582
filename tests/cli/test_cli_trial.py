"""``femfit trial`` from a drawing to its counts."""

import json

import pytest

from support.actuators import GEOMETRY
from support.command import femfit


@pytest.mark.nightly
def test_a_device_is_tried_from_its_drawing_alone(tmp_path):
    text = (GEOMETRY / "emaws-rig.toml").read_text(encoding="utf-8")
    drawing = tmp_path / "rig.toml"
    drawing.write_text(text.replace("stop = 45, step = 0.5", "stop = 45, step = 1.5"), encoding="utf-8")
    done = femfit("trial", "--drawing", drawing, "-o", tmp_path / "trial", "--cases", 6, "--seed", 3)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("Nothing hidden: an effect was named in 0 of")
    results = json.loads((tmp_path / "trial" / "results.json").read_text())
    assert [one["number"] for one in results["cases"]] == [1, 2, 3, 4, 5, 6]
    said = json.loads((tmp_path / "trial" / "campaigns" / "0001" / "diagnosis.json").read_text())
    assert said["verdict"] == results["cases"][0]["verdict"]


@pytest.mark.parametrize(("kind", "has"), [("magnet-pair", "no coil"), ("bearing", "2 coils in 2 circuits")])
def test_a_drawing_that_the_virtual_bench_cannot_measure_is_refused_before_anything_is_solved(kind, has, tmp_path):
    assert femfit("new", kind, "-o", tmp_path / "drawing.toml").returncode == 0
    done = femfit("trial", "--drawing", tmp_path / "drawing.toml", "-o", tmp_path / "trial")
    assert done.returncode != 0
    assert has in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "trial").exists()
