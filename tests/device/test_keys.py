"""A key of the actuator file is one field: everything else follows from it."""

import json
import tomllib
from dataclasses import dataclass, replace

import pytest

from femfit.core.errors import ActuatorFileError, ModelFileError
from femfit.device.complaints import adapter
from femfit.device.drawn_numbers import NumberFacts
from femfit.device.file_numbers import numbers_of
from femfit.device.keys import key, keys_of
from femfit.device.load import actuator_from_toml, starter_text
from femfit.device.mechanics import Mechanics, Stop
from femfit.device.rewrite import rewritten, variants_from_toml
from femfit.model.json_section import read_record, written

PATH = "mechanics.near_stop.damping_N_s_per_m"
DRAWN = starter_text("relay").replace("[mechanics.near_stop]", "[mechanics.near_stop]\ndamping_N_s_per_m = 31 # oil")


@dataclass(frozen=True)
class DampedStop(Stop):
    """A stop with one key more."""

    damping_N_s_per_m: float = key("the damping", 0.0, ge=0, le=1e3)


@pytest.fixture(autouse=True)
def damped_stops(monkeypatch):
    """Stops as if the field were theirs."""
    keys = keys_of(Mechanics)
    monkeypatch.setitem(keys, "near_stop", replace(keys["near_stop"], records=(DampedStop,)))


def test_a_new_key_is_read_written_swept_and_may_be_off():
    assert actuator_from_toml(DRAWN).mechanics.near_stop.damping_N_s_per_m == 31.0
    assert actuator_from_toml(starter_text("relay")).mechanics.near_stop.damping_N_s_per_m == 0.0
    assert PATH in numbers_of(tomllib.loads(DRAWN))
    number = NumberFacts(PATH, (), "length", 31.0, "N_s_per_m", 1.0)
    assert rewritten(DRAWN, [(number, 25.5)], "relay.toml") == DRAWN.replace("= 31 # oil", "= 25.5 # oil")
    swept = variants_from_toml(f'{DRAWN}\n[sweep.parameters]\n"{PATH}" = [1, 2]\n')
    assert [one.actuator.mechanics.near_stop.damping_N_s_per_m for one in swept.variants] == [1.0, 2.0]
    assert actuator_from_toml(f'{DRAWN}\n[tolerances]\n"{PATH}" = 3\n')


@pytest.mark.parametrize(
    ("edit", "mentions"),
    [
        ("damping_N_s_per_m = -1", ["must be at least 0; it is -1", "Give the damping."]),
        ("dampng_N_s_per_m = 1", ["is no known key. Did you mean 'damping_N_s_per_m'?"]),
    ],
)
def test_a_mistake_in_a_new_key_is_said(edit, mentions):
    with pytest.raises(ActuatorFileError) as refused:
        actuator_from_toml(DRAWN.replace("damping_N_s_per_m = 31", edit))
    (problem,) = refused.value.problems
    assert all(words in problem for words in mentions)


def test_a_new_key_is_described_and_stands_in_a_model_file_with_its_limits():
    schema = adapter(keys_of(DampedStop)["damping_N_s_per_m"]).json_schema()
    assert (schema["type"], schema["minimum"], schema["maximum"]) == ("number", 0, 1e3)
    stop = DampedStop(0.001, damping_N_s_per_m=31.0)
    text = json.dumps(written(stop))
    assert read_record(DampedStop, json.loads(text), "model") == stop
    with pytest.raises(ModelFileError, match="damping_N_s_per_m must be a finite number >= 0"):
        read_record(DampedStop, json.loads(text.replace("31.0", "-31.0")), "model")
