"""Write ``data/solenoid_warm_log.csv``: a log of the drawn solenoid whose winding is warmer than drawn.

    python tests/support/replay_page.py runs/solenoid/model.json

The truth has 12 % more resistance (30 K) and else what the model has. Three pulses of 9, 8 and 7 V carry a square wave
of +-3 V, by which the current tells the distance; 3 mA and 5 um of noise; every 0.1 ms. The README's picture is then

    femfit add runs/solenoid/model.json coil_temperature data/solenoid_warm_log.csv -o warm.json --base never \
        --picture data/pictures/replay.png
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

import femfit as ff

STEP_S, WARMER = 1e-4, 1.12
ROOT = Path(__file__).parents[2]


def warm_log(model):
    """The table of three runs."""
    warm = replace(model, circuits=(replace(model.circuit, resistance_ohm=WARMER * model.circuit.resistance_ohm),))
    generator, runs = np.random.default_rng(12), []
    row = np.arange(700)
    for number, volts in enumerate((9.0, 8.0, 7.0)):
        wave = np.where(row % 20 < 10, 3.0, -3.0)
        command = np.where(row < 50, 3.0 + wave, np.where(row < 500, volts + wave, 3.0 + wave))
        loop = ff.simulate(
            warm, drive=ff.Profile("voltage", STEP_S * row, command), duration_s=0.0699, sample_time_s=STEP_S
        )
        current = loop.table["current_A"][:700] + 3e-3 * generator.standard_normal(700)
        distance = loop.table["distance_m"][:700] + 5e-6 * generator.standard_normal(700)
        runs.append(
            pd.DataFrame(
                {
                    "run": number + 1,
                    "time_s": (STEP_S * row).round(4),
                    "voltage_V": command,
                    "current_A": current.round(4),
                    "distance_mm": (1e3 * distance).round(4),
                }
            )
        )
    return pd.concat(runs, ignore_index=True)


if __name__ == "__main__":
    warm_log(ff.read_model(sys.argv[1])).to_csv(ROOT / "data" / "solenoid_warm_log.csv", index=False)
