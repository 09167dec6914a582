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
from femfit.model.json_file import write_model
from support.actuators import GEOMETRY
from support.campaign import campaign
from support.command import femfit, worked
from support.fem_files import SUSPENSION
from support.halves import cut_in_two
from support.impedances import impedance_file
from support.small_drawing import SMALL
from support.solenoids import solenoid
from support.sweeps import force_table


@pytest.fixture(scope="module")
def folder(levitation_model, tmp_path_factory):
    """Inputs that can be read, so that only the option is wrong, and some that cannot."""
    place = tmp_path_factory.mktemp("options")
    model = levitation_model
    write_model(model, place / "model.json")
    write_model(replace(model, sensor=None), place / "blind.json")
    newer = json.loads((place / "model.json").read_text()) | {"schema": 99}
    (place / "later.json").write_text(json.dumps(newer))
    write_model(solenoid(drive=Drive(diode_V=0.7)), place / "solenoid.json")
    write_model(cut_in_two(solenoid()), place / "halves.json")
    bench = campaign(model, 31, runs=2, distances=4, currents=4).rows
    bench.to_csv(place / "bench.csv", index=False)
    bench[:0].to_csv(place / "empty.csv", index=False)
    long = pd.concat([bench[["distance_m", "current_A", "force_N"]]] * (5020 // len(bench) + 1))[:5020].sample(
        frac=1.0, random_state=1
    )
    long.to_csv(place / "long.csv", index=False)
    rows = impedance_file(model, place / "impedance.csv")
    one = pd.read_csv(rows).query("run == 1 and `Bias [A]` == 0")
    one = one[one["gap [mm]"] == one["gap [mm]"].min()]
    one.drop(columns=["gap [mm]", "Bias [A]"]).to_csv(place / "one-impedance.csv", index=False)
    force_table(lambda d, i: 3e-6 * (1.0 + i) / d**2).rows.to_csv(place / "sweep.csv", index=False)
    (place / "bare.csv").write_text("current,position,force\n0,5,1\n0,6,0.9\n1,5,2\n1,6,1.8\n")
    time = np.arange(2000) * 1e-3
    columns = {"time_s": time, "coil_voltage_V": 1e-5 + 0 * time, "hall_T": 0.1 + 0 * time, "current_A": 0.5 * time}
    record = pd.DataFrame(columns)
    record.to_csv(place / "coil.csv", index=False)
    record.assign(distance_m=0.02, current_A=np.linspace(0.0, 9.0, 2000)).to_csv(place / "ramp.csv", index=False)
    record.assign(current_A=40.0).to_csv(place / "strong.csv", index=False)
    loop = {"run": 1, "time_s": time, "voltage_V": 1.0, "true_distance_m": 0.02, "true_current_A": 0.4, "hall_V": 2.6}
    pd.DataFrame(loop).to_csv(place / "loop.csv", index=False)
    record[["coil_voltage_V", "hall_T"]].to_numpy(np.float32).tofile(place / "raw.bin")
    (place / "raw.json").write_text('{"sample_rate_Hz": 1000.0, "columns": ["coil_voltage_V", "hall_T"]}')
    pd.DataFrame({"distance_mm": range(1, 15), "current_A": 1.0, "inductance_H": 0.1}).to_csv(place / "steps.csv")
    (place / "small.toml").write_text(SMALL)
    for name in ("emaws-rig", "emaws-variants", "plunger-solenoid", "emaws"):
        shutil.copyfile(GEOMETRY / f"{name}.toml", place / f"{name}.toml")
    (place / "wordy.toml").write_text("schema = 2\n" + "".join(f"word_{k} = {k}\n" for k in range(400)))
    (place / "old.fem").write_text(SUSPENSION.replace("<Mu_y> = 500", "<Mu_y> = 3"))
    for name in ("magnet-pair", "bearing"):
        worked("new", name, "-o", place / f"{name}.toml")
    for name in ("loop-of-links.csv", "loop-of-links.json"):
        (place / name).symlink_to(name)
    (place / "mine.toml").write_text("mine")
    return place


def contents(place):
    """Every file with its content."""
    files = [path for path in place.rglob("*") if path.is_file()]
    return {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


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
