"""What is wrong with a line is answered with its exit code and what would be right, and nothing is written."""

import hashlib
import json
import shlex
import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit.cli.main import COMMANDS
from femfit.device.electrics import Drive
from femfit.integrate.field_of_current import FieldModel, FieldTerms, write_field_model
from femfit.model.json_file import write_model
from support.actuators import GEOMETRY
from support.campaign import campaign
from support.command import femfit
from support.fem_files import STEEL, suspension
from support.halves import cut_in_two
from support.impedances import impedance_file
from support.small_drawing import SMALL
from support.solenoids import solenoid
from support.sweeps import force_table

VARIANTS = (GEOMETRY / "emaws-variants.toml").read_text(encoding="utf-8")
FEW = VARIANTS[: VARIANTS.index("\n[sweep.parameters]\n")].replace('design = "list"', "#")


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
    long = pd.concat([bench[["distance_m", "current_A", "force_N"]]] * (5020 // len(bench) + 1))[:5020]
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
    terms = FieldTerms(320.0, 2, (5.0,), (3.0,))
    write_field_model(FieldModel(terms, np.full(len(terms.names), 0.1), 1e-4), place / "field.json")
    (place / "small.toml").write_text(SMALL)
    for name in ("emaws-rig", "emaws-variants", "plunger-solenoid", "emaws"):
        shutil.copyfile(GEOMETRY / f"{name}.toml", place / f"{name}.toml")
    (place / "one-current.toml").write_text(FEW.replace("current_A = [0, 0.7, 1.4]", "current_A = [0.7]"))
    (place / "three.toml").write_text(FEW.replace("{ start = 15, stop = 45, step = 5 }", "[15, 19, 24]"))
    (place / "wordy.toml").write_text("schema = 2\n" + "".join(f"word_{k} = {k}\n" for k in range(400)))
    drawing = suspension(header={"Format": 3.2})
    drawing.materials[STEEL]["Mu_y"] = 3
    (place / "old.fem").write_text(drawing.text())
    for name in ("magnet-pair", "bearing"):
        assert femfit("new", name, "-o", place / f"{name}.toml").returncode == 0
    for name in ("loop-of-links.csv", "loop-of-links.json"):
        (place / name).symlink_to(name)
    (place / "mine.toml").write_text("mine")
    return place


def contents(place):
    """Every file with its content."""
    files = [path for path in place.rglob("*") if path.is_file()]
    return {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


USAGE = """
nosuch
sweep
fit
import bare.csv
import-fem old.fem
add model.json hall_offset bench.csv
sweep small.toml --workers 0
fit sweep.csv --model F9                          | F1e
fit sweep.csv --model coenergy --constraints rising
fit sweep.csv --model F1e --functions cubic,cubic
fit sweep.csv --model F1e --bound d^-9=0:1
fit sweep.csv --model F1e --bound d^-4            | COLUMN=LOW:HIGH | d^-4=0:1e-8
fit sweep.csv --model F1e --bound d^-4=1          | COLUMN=LOW:HIGH
fit sweep.csv --model F1e --bound d^-4=a:b        | COLUMN=LOW:HIGH
fit sweep.csv --model F1e --bound d^-4=nan:1      | 'd^-4=nan:1'
fit sweep.csv --supply-V 12
fit sweep.csv --where variant                     | --where | COLUMN=VALUE
diagnose model.json bench.csv --exclude gremlins
diagnose model.json bench.csv --bootstrap -1
add model.json gremlins bench.csv -o new          | core_saturation
suggest model.json                                | --plan
compare model.json bench.csv --unit force_N       | --unit
compare model.json bench.csv --noise force_N=little | --noise
compare model.json one-impedance.csv --setting distance_mm=two | COLUMN=NUMBER
export model.json --to fmu -o new                 | estimator
export model.json                                 | --output
simulate model.json --filter ukf9
simulate model.json --runs 0
simulate model.json --seconds -1
simulate model.json --dropout 2
simulate model.json --seed -1
simulate model.json --controller fuzzy
heat plunger-solenoid.toml --frequency-Hz 50      | frequency | sweep
import bare.csv -o new --flip-force --keep-force  | exclude
import bare.csv -o new --file-current-A one       | commas
view emaws-rig.toml --row 1                       | run directory
view emaws-rig.toml --what mesh --what vtu -o new.png | directory
view emaws-rig.toml --what mesh -o new.vtu        | mesh
view emaws-rig.toml -o new.gif                    | .png | .svg | .pdf
simulate solenoid.json --voltage 12 --controller pid | open loop
simulate solenoid.json --voltage 12 --noise 3     | open loop
simulate solenoid.json --voltage 12 --force-scale 1.1 | open loop
simulate solenoid.json --voltage 12 --runs 3      | open loop
simulate solenoid.json --duration-ms 5            | --voltage
view bearing.toml --distance-mm 0.5 --current-A 1 | lower, upper
simulate halves.json --voltage inner=six          | bias=2,diff=1
calibrate small.toml -o new.toml                  | measurement
calibrate small.toml bench.csv --numbers moving.magnet.height_mm -o new.toml | number of this drawing
calibrate small.toml bench.csv --numbers remanence --with nothing_like_it -o new.toml | nothing_like_it
"""

ERRORS = """
run nosuch.toml                                   | nosuch.toml
sweep nosuch.toml                                 | nosuch.toml
fit nosuch                                        | nosuch
fit nosuch.csv                                    | nosuch.csv
export nosuch.json -o new                         | nosuch.json
simulate nosuch.json                              | nosuch.json
import nosuch.csv -o new                          | nosuch.csv
import-fem nosuch.fem -o new.toml                 | nosuch.fem
compare model.json nosuch.csv                     | nosuch.csv
audit nosuch.json
simulate later.json                               | schema 99 | Update femfit
export later.json -o new                          | schema 99
export bench.csv -o new                           | bench.csv | JSON
simulate blind.json                               | [sensors.NAME]
import bare.csv -o new                            | --unit distance_m=mm
import bare.csv -o new --column nothing=force     | columns
import bare.csv -o new --unit force=parsec        | --unit force
import-fem old.fem -o new/a.toml                  | old.fem | 3.2 | anisotropic
new ball -o mine.toml                             | mine.toml
run one-current.toml -o new                       | 3 currents | 5 distances
run three.toml -o new                             | 3 currents and 3 distances
run emaws-variants.toml -o new                    | sweep.parameters
sweep emaws-variants.toml -o new --signatures     | one variant
sweep wordy.toml                                  | more
view emaws-rig.toml --distance-mm 5               | 15 to 45 mm
observe model.json bench.csv                      | time_s
compare model.json bench.csv --noise forc_N=1     | force_N
compare model.json one-impedance.csv              | --setting distance_mm
compare model.json loop.csv                       | current_A | distance_m
diagnose model.json loop.csv                      | current_A | distance_m
compare model.json long.csv                       | 5,000 | 5,020
compare model.json .
compare model.json loop-of-links.csv
compare loop-of-links.json bench.csv
audit loop-of-links.json
fit loop-of-links.csv
integrate . -o new.csv
observe model.json .
simulate loop-of-links.json
bench . -o new.csv
bench coil.csv -o new.csv                         | distance_m
bench ramp.csv -o new.csv --still-A 1e-6          | 2 plateaus
integrate coil.csv --coil-area 0 -o new.csv       | > 0 m2
integrate coil.csv --method cs1-offset -o new.csv | --coil-area
integrate coil.csv --method cs2-identified --coil-area 0.05 -o new.csv | --lab
integrate coil.csv --method cs2 --coil-area 0.05 -o new.csv | --current-to-field
integrate coil.csv --method ffa1 -o new.csv       | --zero-reading-s
integrate coil.csv --method ffa2 --lab coil.csv --field-model field.json -o new.csv | does not use
integrate coil.csv --coil-area 0.05 --method cs2-identified --model model.json -o new.csv | --model | --distance-mm
integrate coil.csv --coil-area 0.05 --method cs2-identified --model model.json --distance-mm 500 -o new.csv | fitted
integrate coil.csv -o new.csv --json new.csv      | new.csv
integrate coil.csv -o new.xlsx                    | .csv
calibrate small.toml empty.csv --numbers remanence -o new.toml | empty.csv
calibrate small.toml bench.csv --numbers remanence -o mine.toml | mine.toml
calibrate emaws-variants.toml bench.csv -o new.toml | sweep.parameters
"""

TABLES = ((2, USAGE), (1, ERRORS))
LINES = [(code, *line.partition("|")[::2]) for code, text in TABLES for line in text.strip().splitlines()]


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


def test_a_scheduler_that_does_not_answer_is_named_before_anything_is_solved(folder):
    done = femfit("sweep", "emaws.toml", "-o", "scheduled", "--scheduler", "nonsense://host:1", cwd=folder)
    assert (done.returncode, "'nonsense://host:1'" in done.stderr) == (1, True)
    assert [path.name for path in (folder / "scheduled").iterdir()] == ["journal.jsonl"]


@pytest.mark.parametrize("name", [name for name, _, _ in COMMANDS])
def test_every_command_explains_itself(name):
    done = femfit(name, "--help")
    assert done.returncode == 0
    assert "--json" in done.stdout or name == "new"  # which makes a drawing and has no result
