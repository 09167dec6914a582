"""What becomes of a drawing elsewhere: designs of a sweep, records of actuators, errors across processes."""

import json
import pickle
from dataclasses import asdict
from pathlib import Path
from types import UnionType
from typing import get_args, get_origin

import numpy as np
import pytest

from femfit.core.errors import ActuatorFileError, FemfitError
from femfit.core.results import json_ready
from femfit.device.keys import keys_of, kind_of
from femfit.device.load import actuator_from_record, actuator_from_toml, read_actuator, sweep_manifest_entry
from femfit.device.mechanics import Mechanics
from femfit.device.parts import MovingPart
from femfit.device.read_device import check_circuit_names
from femfit.device.rewrite import variants_from_toml
from femfit.device.schema import FileEntry, FixedEntry, SomeSensor
from femfit.device.tolerances import read_tolerances
from femfit.model.impedance import impedances_by_column
from support.actuators import GEOMETRY

DRAWINGS = Path(__file__).parent / "drawings"
MOVING_COIL = (DRAWINGS / "moving-coil.toml").read_text(encoding="utf-8")
RIG = (GEOMETRY / "emaws-rig.toml").read_text(encoding="utf-8")
HYPERCUBE = 'design = "latin_hypercube"\nsamples = 20\nseed = 7'


def sampled(parameters, head=HYPERCUBE):
    return variants_from_toml(RIG.replace("[sweep]", f"[sweep.parameters]\n{parameters}\n[sweep]\n{head}\n", 1))


def test_a_latin_hypercube_has_one_sample_in_each_slice_and_each_material_equally_often():
    ranges = """"coils.coil.turns" = { min = 100, max = 300 }
        "materials.ferrite.relative_permeability" = { min = 300, max = 600 }
        "moving.regions.magnet.material" = ["n42", "n52"]"""
    sweep = sampled(ranges)
    for place, (low, high) in enumerate([(100, 300), (300, 600)]):
        slices = sorted(int(20 * (one.values[place] - low) / (high - low)) for one in sweep.variants)
        assert slices == list(range(20))
    grades = [one.values[2] for one in sweep.variants]
    assert (grades.count("n42"), grades.count("n52")) == (10, 10)
    assert sweep.actuator == actuator_from_toml(RIG)
    assert sampled(ranges) == sweep  # the seed alone decides
    assert sampled(ranges, HYPERCUBE.replace("7", "8")) != sweep


def test_a_step_keeps_turns_whole_and_draws_each_equally_often():
    turns = [one.values[0] for one in sampled('"coils.coil.turns" = { min = 301, max = 305, step = 1 }').variants]
    assert {value: turns.count(value) for value in turns} == dict.fromkeys((301, 302, 303, 304, 305), 4)


@pytest.mark.parametrize("path", sorted(GEOMETRY.glob("*.toml")), ids=lambda path: path.stem)
def test_each_drawing_of_the_project_loads_under_its_own_name_and_its_record_rebuilds_it(path):
    text = path.read_text(encoding="utf-8")
    assert variants_from_toml(text, directory=GEOMETRY).variants
    actuator = read_actuator(path)
    assert actuator.name == path.stem
    record = json.loads(json.dumps(json_ready(asdict(actuator)), allow_nan=False))
    assert actuator_from_record(record, "record") == actuator
    json.dumps(sweep_manifest_entry(actuator), allow_nan=False)


@pytest.mark.parametrize(
    ("names", "column"),
    [
        (("a", "b", "a_b"), "inductance_a_b_H"),
        (("b_a", "a", "b"), "inductance_b_a_H"),
        (("a", "b", "b_shorted"), "inductance_a_b_shorted_H"),
        (("a", "b", "a_b_shorted"), "inductance_a_b_shorted_H"),
        (("a", "b_c", "a_b", "c"), "inductance_a_b_c_H"),
        *((names, "") for names in ((), ("a",), ("coil_1", "coil_2", "coil_3"), ("a", "a_b"), ("a", "a_shorted"))),
    ],
)
def test_circuits_of_which_two_impedances_had_one_column_are_refused(names, column):
    problems = []
    check_circuit_names(names, problems)
    assert len(problems) == bool(column)
    assert column in " ".join(problems)
    if not column and len(names) > 1:
        assert len(impedances_by_column(np.eye(len(names)), names)) == len(names) * (2 * len(names) - 1)


def test_a_file_that_is_absent_or_a_directory_is_an_error_of_the_file(tmp_path):
    for path in (tmp_path, tmp_path / "none.toml"):
        with pytest.raises(ActuatorFileError) as refused:
            read_actuator(path)
        assert refused.value.source == str(path)


def test_a_byte_order_mark_is_no_mistake_and_the_error_of_one_survives_a_process_boundary(tmp_path):
    (tmp_path / "actuator.toml").write_text(MOVING_COIL, encoding="utf-8-sig")
    assert read_actuator(tmp_path / "actuator.toml").name == "voice-coil"
    with pytest.raises(FemfitError, match=r"a\.toml") as refused:
        actuator_from_toml(MOVING_COIL.replace("turns = 100", "turns = 0"), "a.toml")
    copy = pickle.loads(pickle.dumps(refused.value))  # noqa: S301  our own bytes
    assert (str(copy), copy.problems) == (str(refused.value), refused.value.problems)


PLACES = {
    ".".join((*place, name) if not key.named else (*place, name, kind_of(record) or record.__name__)): record
    for place, above in {
        (): FileEntry,
        ("fixed",): FixedEntry,
        ("moving",): MovingPart,
        ("mechanics",): Mechanics,
    }.items()
    for name, key in keys_of(above).items()
    for record in key.records
    if record is not SomeSensor
}


def numbers_in(path, hint):
    """Key paths of the numbers that a key holds, each of its lists with two values, and an example."""
    for one in get_args(hint) if isinstance(hint, UnionType) else [hint]:
        if one in (float, int):
            return [path], 1.0
        if get_origin(one) is tuple and (inner := numbers_in("", get_args(one)[0])):
            return [f"{path}[{k}]{deeper}" for k in (0, 1) for deeper in inner[0]], [inner[1], inner[1]]
    return None


@pytest.mark.parametrize("place", PLACES)
def test_every_number_of_a_table_may_be_off_or_is_refused_by_its_path(place):
    found = {name: numbers_in(f"{place}.{name}", key.hint) for name, key in keys_of(PLACES[place]).items()}
    held = {name: numbers for name, numbers in found.items() if numbers}
    # Any that is no list may be left out
    table = {"kind": place.partition(".")[2]} | {name: one for name, (_, one) in held.items() if isinstance(one, list)}
    for name in reversed(place.split(".")):
        table = {name: table}
    assert held or place in {"fixed", "moving"}
    for path in (path for paths, _ in held.values() for path in paths):
        problems = []
        tolerances, _ = read_tolerances({"schema": 2, "sweep": {}, "tolerances": {path: 0.1}, **table}, problems)
        refused = place in {"thermal", "solver", "reference"} or path.endswith("bits")
        assert (tolerances == {path: 0.1}) is not refused, (path, problems)
        assert not refused or path in problems[0]
