"""What is wrong with a line is answered with its exit code and what would be right, and nothing is written."""

import hashlib
import json
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from femfit.cli.main import COMMANDS
from femfit.device.electrics import Drive
from femfit.device.load import starter_text
from femfit.model.json_file import write_model
from support.actuators import GEOMETRY
from support.command import femfit
from support.fem_files import SUSPENSION
from support.halves import cut_in_two
from support.impedances import impedance_file
from support.solenoids import solenoid
from support.sweeps import force_table


@pytest.fixture(scope="module")
def folder(case, levitation_model, tmp_path_factory):
    """Inputs that can be read, so that only the option is wrong, and some that cannot."""
    place = tmp_path_factory.mktemp("options")
    for name in ("model.json", "bench.csv", "small.toml"):
        shutil.copy(case.folder / name, place)
    for name in ("emaws-rig", "emaws-variants", "plunger-solenoid", "emaws"):
        shutil.copy(GEOMETRY / f"{name}.toml", place)
    for name in ("magnet-pair", "bearing"):
        (place / f"{name}.toml").write_text(starter_text(name))
    write_model(replace(levitation_model, sensor=None), place / "blind.json")
    write_model(solenoid(drive=Drive(diode_V=0.7)), place / "solenoid.json")
    write_model(cut_in_two(solenoid()), place / "halves.json")
    (place / "later.json").write_text(json.dumps(json.loads((place / "model.json").read_text()) | {"schema": 99}))
    bench, time = pd.read_csv(place / "bench.csv"), np.arange(2000) * 1e-3
    long = pd.concat([bench[["distance_m", "current_A", "force_N"]]] * (5020 // len(bench) + 1))[:5020]
    impedance = pd.read_csv(impedance_file(levitation_model, place / "impedance.csv"))
    first = impedance.query("run == 1 and `Bias [A]` == 0 and `gap [mm]` == `gap [mm]`.min()")
    coil = pd.DataFrame({"time_s": time, "coil_voltage_V": 1e-5, "hall_T": 0.1, "current_A": 0.5 * time})
    loop = {"run": 1, "time_s": time, "voltage_V": 1.0, "true_distance_m": 0.02, "true_current_A": 0.4, "hall_V": 2.6}
    tables = {
        "empty": bench[:0],
        "long": long.sample(frac=1.0, random_state=1),
        "one-impedance": first.drop(columns=["gap [mm]", "Bias [A]"]),
        "sweep": force_table(lambda d, i: 3e-6 * (1.0 + i) / d**2).rows,
        "bare": pd.DataFrame({"current": [0, 0, 1, 1], "position": [5, 6, 5, 6], "force": [1, 0.9, 2, 1.8]}),
        "coil": coil,
        "ramp": coil.assign(distance_m=0.02, current_A=np.linspace(0.0, 9.0, 2000)),
        "loop": pd.DataFrame(loop),
        "steps": pd.DataFrame({"distance_mm": range(1, 15), "current_A": 1.0, "inductance_H": 0.1}),
    }
    for name, rows in tables.items():
        rows.to_csv(place / f"{name}.csv", index=False)
    coil[["coil_voltage_V", "hall_T"]].to_numpy(np.float32).tofile(place / "raw.bin")
    (place / "raw.json").write_text('{"sample_rate_Hz": 1000.0, "columns": ["coil_voltage_V", "hall_T"]}')
    (place / "wordy.toml").write_text("schema = 2\n" + "".join(f"word_{k} = {k}\n" for k in range(400)))
    (place / "old.fem").write_text(SUSPENSION.replace("<Mu_y> = 500", "<Mu_y> = 3"))
    (place / "mine.toml").write_text("mine")
    for name in ("loop-of-links.csv", "loop-of-links.json"):
        (place / name).symlink_to(name)
    return place


def contents(place):
    return {path: hashlib.sha256(path.read_bytes()).digest() for path in place.rglob("*") if path.is_file()}


ROWS = [row.partition(" ")[::2] for row in Path(__file__).with_name("wrong-lines.txt").read_text().splitlines()[1:]]
LINES = [(int(code), *line.partition("|")[::2]) for code, line in ROWS]


@pytest.mark.parametrize(("code", "line", "mentions"), LINES, ids=lambda value: str(value).strip())
def test_a_wrong_line_ends_with_its_code_and_names_what_is_wrong(folder, code, line, mentions):
    before = contents(folder)
    done = femfit(*shlex.split(line), cwd=folder)
    assert done.returncode == code, done.stderr
    text = " ".join((done.stdout + done.stderr).split())
    assert all(word.strip() in text for word in mentions.split("|"))
    assert "Traceback" not in text
    assert len(done.stderr) < 6000
    assert contents(folder) == before
    assert not list(folder.glob("new*"))


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_explains_itself(name):
    done = femfit(name, "--help")
    assert done.returncode == 0
    assert "--json" in done.stdout or name == "new"  # which makes a drawing and has no result
