"""``femfit heat``."""

import json

from support.actuators import GEOMETRY
from support.command import femfit


def test_temperatures_are_told_and_written(tmp_path):
    file = tmp_path / "heat.json"
    done = femfit("heat", GEOMETRY / "plunger-solenoid.toml", "--current-A", 0.5, "--distance-mm", 2, "--json", file)
    assert done.returncode == 0
    assert done.stdout.startswith("0.500 A for ever: the winding settles at")
    found = json.loads(file.read_text())
    assert found["distance_m"] == 2e-3
    assert len(found["conductances_W_per_K"]) == len(found["names"]) == 5


def test_a_wrong_combination_is_refused():
    done = femfit("heat", GEOMETRY / "plunger-solenoid.toml", "--frequency-Hz", 50)
    assert done.returncode == 2
    assert "both a frequency and a sweep" in done.stderr
