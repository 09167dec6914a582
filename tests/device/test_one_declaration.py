"""A key is one field and a kind of sensor one class with one function: what follows from them, in a copy of femfit."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
INSERTED = {
    "device/mechanics.py": {
        "    restitution: float": '    rubber_m: float = key("the thickness of the rubber in mm", 0.0, ge=0, le=50)\n'
    },
    "device/electrics.py": {
        "AnySensor: TypeAlias = ": """class AngleSensor(Sensor):
    UNIT, COLUMN = "deg", "angle_deg"
    lead_m: float = key("the way of one turn of the spindle in mm", gt=0, le=1e3)
    kind: Literal["angle"] = key('"angle" for a spindle', "angle", required=True)


"""
    },
    "model/sensing.py": {
        "READINGS: dict": """def _angle(sensor, equations, state, _voltage, at):
    return 360.0 * _setting(equations, state, at)[0] / sensor.lead_m


"""
    },
}
NAMED = {
    "device/electrics.py": {"| ForceSensor\n": "| ForceSensor | AngleSensor\n"},
    "model/hall.py": {
        "import AccelerationSensor": "import AngleSensor, AccelerationSensor",
        "OtherSensor: TypeAlias = ": "OtherSensor: TypeAlias = AngleSensor | ",
    },
    "model/sensing.py": {
        "import AccelerationSensor": "import AngleSensor, AccelerationSensor",
        "    HallSensor: _hall,": "    AngleSensor: _angle,\n    HallSensor: _hall,",
    },
}
DRAWN = """
[mechanics.near_stop]
distance_mm = 14
rubber_mm = 1.5
[sensors.turn]
kind = "angle"
lead_mm = 5
range_deg = [0, 3600]
bits = 12
[tolerances]
"mechanics.near_stop.rubber_mm" = 0.1
"sensors.turn.lead_mm" = 0.01
"""


def asked(root, drawn):
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
    assert unknown.startswith(
        "sensors.turn.leed_mm is no known key. Did you mean 'lead_mm'? Known here: lead_mm, kind,"
    )
    described = json_schema()["properties"]
    assert described["mechanics"]["properties"]["near_stop"]["properties"]["rubber_mm"]["maximum"] == 50
    assert "lead_mm" in json.dumps(described["sensors"])
    assert "| `rubber_mm` | mm | Give the thickness of the rubber in mm. | 0 to 50 | `0` |" in page()
    model = read_model(root / "tests/golden/inputs/models/rig.json")
    model = replace(
        model, motion=replace(model.motion, near_stop=actuator.mechanics.near_stop), other_sensors=(sensor,)
    )
    filed = model_to_dict(model)
    assert (filed["motion"]["near_stop"]["rubber_m"], filed["other_sensors"][0]["lead_m"]) == (0.0015, 0.005)
    assert model_to_dict(model_from_dict(json.loads(json.dumps(filed)))) == filed
    reading = reading_of(model, "turn")
    assert (reading.unit, reading.column, reading.high, reading.bits) == ("°", "angle_deg", 3600.0, 12)
    np.testing.assert_allclose(predict_sensor(model, sensor, np.array([0.02, 0.0, 0.1])), 1440.0, rtol=1e-12)


def test_a_new_key_is_one_field_and_a_new_kind_of_sensor_one_class_and_one_function(tmp_path):
    shutil.copytree(ROOT / "femfit", tmp_path / "femfit", ignore=shutil.ignore_patterns("__pycache__"))
    for changes, before in ((INSERTED, True), (NAMED, False)):
        for name, places in changes.items():
            path = tmp_path / "femfit" / name
            text = path.read_text(encoding="utf-8")
            for place, new in places.items():
                assert text.count(place) == 1, (name, place)
                text = text.replace(place, new + place if before else new)
            path.write_text(text, encoding="utf-8")
    paths = [str(tmp_path), str(ROOT / "docs/_ext"), str(Path(__file__).parent)]
    program = f"import sys; sys.path[:0] = {paths}\nfrom pathlib import Path\nimport test_one_declaration as t\n"
    program += f"import femfit; assert femfit.__file__.startswith({str(tmp_path)!r})\n"
    program += f"t.asked(Path({str(ROOT)!r}), t.DRAWN)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert not done.returncode, done.stderr[-3000:]
