"""The measured levitation rig's published files as tables that femfit's commands read.

The files themselves are not in the repository: github.com/Bocchio01/062020-Lab-Mechatronics, commit 0d77d8e, MIT
licence, and the inductances and hover plateaus extracted from them.
"""

from pathlib import Path

import numpy as np
import pandas as pd

POLIMI = Path(__file__).parents[2].parent / "shared" / "reference" / "polimi"
MASS_G, RESISTANCE_OHM = 61.57, 4.17
"""By the authors' report."""

FLOOR_N = 0.05 * 1e-3 * MASS_G * 9.80665
"""The same place needs 0.93 to 0.97 A in different runs: 2.5 % of the current, which are 5 % of the force."""

STEADY_A = (1.1, 1.75)
"""Steps whose inductance neither iron at a low field nor a saturating one lowers."""


def read(name):
    """A table of the folder."""
    return pd.read_csv(POLIMI / name, comment="#")


def write_raw(folder, name):
    """One of the raw records as a table, ``NAME.csv``: distance, current, and the duty cycle as a voltage."""
    volts = read("pwm_to_voltage.csv")
    with np.load(POLIMI / "raw" / f"{name}.npz") as raw:
        columns = {key: raw[key].ravel() for key in raw.files}
    current, duty = (columns.get(f"{key}1", columns.get(key)) for key in "iu")
    table = {
        "time_s": columns["t"],
        "distance_m": columns["z"],
        "current_A": current,
        "voltage_V": np.interp(duty, volts["pwm"], volts["coil_V"]),
    }
    pd.DataFrame(table).to_csv(folder / f"{name}.csv", index=False)
    return folder / f"{name}.csv"


def write_tables(folder):
    """``steps.csv``, ``steady.csv``, ``hover.csv`` with its noise, and ``record.csv``.

    Hover plateaus are readings of a force, the weight; the record is one closed loop at 1 kHz from the second on in
    which the sphere hangs, its duty cycle as the voltage that a multimeter read.
    """
    found = read("L_step_response.csv")
    steps = pd.DataFrame(
        {"distance_mm": found["z_mm"], "current_A": found["i_ss_A"], "inductance_mH": found["L_mH_eff"]}
    )
    steps.to_csv(folder / "steps.csv", index=False)
    steps[steps["current_A"].between(*STEADY_A)].to_csv(folder / "steady.csv", index=False)
    hover = read("hover_points.csv")
    hover = hover[hover["kind"] == "MEASURED"]
    pd.DataFrame(
        {
            "run": pd.factorize(hover["run"])[0] + 1,
            "distance_mm": hover["z_mm"],
            "current_A": hover["I1_A"],
            "force_N": 1e-3 * MASS_G * 9.80665,
        }
    ).to_csv(folder / "hover.csv", index=False)
    (folder / "hover.toml").write_text(f"[noise]\nforce_N = {FLOOR_N:.3f}\n")
    volts = read("pwm_to_voltage.csv")
    with np.load(POLIMI / "raw" / "multisteps_updown__MPC-KF.npz") as raw:
        columns = {name: raw[name].ravel() for name in ("t", "z", "i1", "u1")}
    hanging = columns["t"] >= 1.0
    pd.DataFrame(
        {
            "time_s": columns["t"],
            "distance_m": columns["z"],
            "current_A": columns["i1"],
            "voltage_V": np.interp(columns["u1"], volts["pwm"], volts["coil_V"]),
        }
    )[hanging].to_csv(folder / "record.csv", index=False)
