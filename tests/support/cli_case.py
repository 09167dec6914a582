"""A folder with every input that a command reads, and the line by which each command is run once, in a process."""

import re
import shlex
from pathlib import Path

import numpy as np
import pandas as pd

from femfit.device.load import actuator_from_toml
from femfit.field.sweep import run_sweep
from femfit.identify.settings import conditions_of
from femfit.model.json_file import write_model
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of
from support.campaign import campaign, hidden, settings
from support.command import femfit, separate_femfit
from support.fem_files import suspension
from support.replays import TRUE, damped, logs
from support.small_drawing import SLEEVED, SMALL
from support.small_records import coil_record

FACE = "moving.regions.magnet.z_mm[1]"
DRAWN = SMALL.replace("{ start = 4, stop = 12, step = 1 }", "[4, 5, 6, 7, 8, 9.5, 11, 12.5]")
"""Of the device that is calibrated."""

COMMANDS = Path(__file__).parents[1] / "cli" / "commands.txt"
EVERY = {
    name: (line, after)
    for name, after, line in re.findall(r"(?m)^([\w-]+)(?: \((\w+)\))?: (.+)$", COMMANDS.read_text(encoding="utf-8"))
}
ONCE = {name: line for name, (line, _) in EVERY.items() if line.split()[0] == name}
"""Each command but ``trial``, whose room is its own."""

SLOW = ("calibrate",)
"""Commands that take a quarter of a minute."""


class Case:
    """The folder, and what each command printed there."""

    def __init__(self, folder):
        self.folder, self.done = folder, {}

    def run(self, name):
        """Run a command once, after what it needs."""
        if name not in self.done:
            line, after = EVERY[name]
            if after:
                self.run(after)
            if name == "calibrate":
                taller(self.folder).to_csv(self.folder / "taller.csv", index=False)
            start = separate_femfit if name == "new" else femfit  # as a user starts it: loading takes a second or two
            self.done[name] = done = start(*shlex.split(line), cwd=self.folder)
            assert done.returncode == 0, done.stderr
        return self.done[name]


def write_inputs(model, folder):
    """Every input."""
    write_model(model, folder / "model.json")
    for name, text in (("small", SMALL), ("sleeved", SLEEVED), ("drawn", DRAWN)):
        (folder / f"{name}.toml").write_text(text)
    size = {"distances": 6, "currents": 5}
    campaign(model, 41, **size).rows.to_csv(folder / "clean.csv", index=False)
    effects = [hidden("hall_offset", offset_V=0.02), hidden("distance_offset", offset_m=2e-4)]
    campaign(model, 51, effects, runs=4, **size).rows.to_csv(folder / "bench.csv", index=False)
    lines = ["Strom (A);Luftspalt (mm);Kraft (mN)"]
    lines += [f"{i};{d};{1e3 * (i + 0.5) / d**2:.8g}" for i in (0.0, 0.5, 1.0) for d in np.linspace(5, 15, 11)]
    (folder / "kraft.csv").write_text("\n".join(lines).replace(".", ","), encoding="cp1252")
    (folder / "pull magnet.fem").write_text(suspension("inches", below=True, face=3.0))
    write_model(damped(), folder / "solenoid.json")
    write_model(damped({**TRUE, "laser": 1e-5}), folder / "damped.json")
    log = logs(1500, 1, seed=8)[1][0].rows
    log[["time_s", "voltage_V", "current_A", "distance_m"]].to_csv(folder / "log.csv", index=False)
    coil_record(folder / "coil.csv", 2.0)
    plateaus(model).to_csv(folder / "plateaus.csv", index=False)


def taller(folder):
    """One run of a device with a taller magnet, with white noise."""
    rows = run_sweep(actuator_from_toml(DRAWN.replace("z_mm = [0, 4]", "z_mm = [0, 4.05]")), folder / "true", workers=1)
    noise = 5e-5 * np.random.default_rng(5).standard_normal(len(rows.rows))
    return rows.rows[["distance_m", "current_A"]].assign(force_N=rows.rows["force_N"] + noise)


RATE, HOLD = 20.0, 20
"""Samples a second, and of a plateau; one sample half way follows, whose two trapezoids are the step."""


def plateaus(model, resistance_ohm=2.69, offset_V=2e-6, noise_V=2e-6):
    """A voltage whose trapezoids are the model's flux linkage, plus R i, a growing offset and white noise."""
    generator = np.random.default_rng(4)
    plan = settings(model, runs=3, distances=8, currents=6)
    pieces = []
    for run in (1, 2, 3):
        rows = plan[plan["run"] == run].reset_index(drop=True)
        at = conditions_of(rows.assign(run=0, mount=0, elapsed=rows["order"]), nominal_of(model))
        read = predict_readings(model, rows["distance_m"].to_numpy(), rows["current_A"].to_numpy(), at)
        current, distance = (_with_steps(rows[name]) for name in ("current_A", "distance_m"))
        time = np.arange(len(current)) / RATE
        change = np.diff(read["flux_linkage_Wb"]) * RATE
        induced = np.zeros(len(current))
        induced[HOLD :: HOLD + 1][: len(change)] = change
        offset = offset_V * (run + time / time[-1])
        voltage = induced + resistance_ohm * current + offset + generator.normal(0.0, noise_V, len(current))
        columns = {"run": run, "time_s": time, "coil_voltage_V": voltage, "current_A": current, "distance_m": distance}
        pieces.append(pd.DataFrame(columns))
    return pd.concat(pieces)


def _with_steps(column):
    held = np.asarray(column)
    half_way = 0.5 * (held + np.append(held[1:], held[-1]))
    return np.concatenate([np.append(np.full(HOLD, one), half) for one, half in zip(held, half_way, strict=True)])
