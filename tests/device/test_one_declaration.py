"""A key is one field and a kind of sensor one class with one function: what follows from them, in a copy of femfit."""

import shutil
import tomllib
from pathlib import Path

import pytest

from support.command import python

ROOT = Path(__file__).parents[2]
EDITS = tomllib.loads(Path(__file__).with_name("one_declaration.toml").read_text(encoding="utf-8"))


def asked(root=ROOT, drawn=EDITS["drawn"]):
    """What the copy makes of the key and of the sensor: run there."""
    import json
    from dataclasses import replace

    import numpy as np

    from actuator_file import page
    from femfit.core.errors import ActuatorFileError
    from femfit.device.load import actuator_from_toml, sweep_manifest_entry
    from femfit.device.schema import json_schema
    from femfit.fit.model_parts import other_sensors_of
    from femfit.model.json_file import model_from_dict, model_to_dict, read_model
    from femfit.model.sensors import predict_sensor, reading_of

    text = (root / "geometry/emaws-rig.toml").read_text(encoding="utf-8") + drawn
    actuator = actuator_from_toml(text)
    (sensor,), _ = other_sensors_of({"sensors": sweep_manifest_entry(actuator)["sensors"][1:]}, {})
    assert (actuator.mechanics.near_stop.rubber_m, sensor) == (0.0015, actuator.sensors[1])
    with pytest.raises(ActuatorFileError) as refused:
        actuator_from_toml(text.replace("rubber_mm = 1.5", "rubber_mm = -1").replace("lead_mm = 5", "leed_mm = 5"))
    stop, missing, unknown, *_ = refused.value.problems
    assert stop == "mechanics.near_stop.rubber_mm must be at least 0; it is -1. Give the thickness of the rubber in mm."
    assert missing == "sensors.turn.lead_mm is missing. Give the way of one turn of the spindle in mm."
    known = "Did you mean 'lead_mm'? Known here: lead_mm, kind,"
    assert unknown.startswith(f"sensors.turn.leed_mm is no known key. {known}")
    described = json_schema()["properties"]
    assert described["mechanics"]["properties"]["near_stop"]["properties"]["rubber_mm"]["maximum"] == 50
    assert "lead_mm" in json.dumps(described["sensors"])
    assert "| `rubber_mm` | mm | Give the thickness of the rubber in mm. | 0 to 50 | `0` |" in page()
    model = read_model(root / "tests/golden/inputs/models/rig.json")
    motion = replace(model.motion, near_stop=actuator.mechanics.near_stop)
    model = replace(model, motion=motion, other_sensors=(sensor,))
    filed = model_to_dict(model)
    assert (filed["motion"]["near_stop"]["rubber_m"], filed["other_sensors"][0]["lead_m"]) == (0.0015, 0.005)
    assert model_to_dict(model_from_dict(json.loads(json.dumps(filed)))) == filed
    reading = reading_of(model, "turn")
    assert (reading.unit, reading.column, reading.high, reading.bits) == ("°", "angle_deg", 3600.0, 12)
    assert predict_sensor(model, sensor, np.array([0.02, 0.0, 0.1])) == pytest.approx(1440.0, rel=1e-12)


def test_a_new_key_is_one_field_and_a_new_kind_of_sensor_one_class_and_one_function(tmp_path):
    shutil.copytree(ROOT / "femfit", tmp_path / "femfit", ignore=shutil.ignore_patterns("__pycache__"))
    for way in ("before", "instead"):
        for name, places in EDITS[way].items():
            path = tmp_path / "femfit" / name
            text = path.read_text(encoding="utf-8")
            for place, new in places.items():
                assert text.count(place) == 1, (name, place)
                text = text.replace(place, new + place if way == "before" else new)
            path.write_text(text, encoding="utf-8")
    paths = [str(tmp_path), *(str(ROOT / place) for place in ("docs/_ext", "tests", "tests/device"))]
    code = f"import sys; sys.path[:0] = {paths}\nimport femfit, test_one_declaration as here\nhere.asked()"
    python(f"{code}\nassert femfit.__file__.startswith({str(tmp_path)!r})", cwd=tmp_path)
