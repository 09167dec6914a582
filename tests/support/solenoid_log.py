"""Writes data/solenoid_log.csv again, from what ``femfit run geometry/solenoid.toml`` fits: python FILE MODEL.

Three pulses of a solenoid whose spring is half as stiff again as drawn, with white noise of current and distance.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd

import femfit as ff
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.model.with_effects import with_effects
from femfit.simulation.profile import Profile

LOG = Path(__file__).parents[2] / "data" / "solenoid_log.csv"
PULSES = {1: (12.0, 0.06), 2: (10.0, 0.08), 3: (8.0, 0.08)}
START_S, END_S, STEP_S = 0.005, 0.2, 2e-4


def solenoid_log(model, seed=1):
    spring = AddedEffect(effect_by_name("spring_stiffness"), {"stiffness_error": 0.5})
    generator, runs = np.random.default_rng(seed), []
    for run, (voltage, length) in PULSES.items():
        pulse = Profile(
            "voltage", np.array([0.0, START_S, START_S + length, END_S]), np.array([0.0, voltage, 0.0, 0.0])
        )
        table = pd.DataFrame(ff.simulate(with_effects(model, (spring,)), drive=pulse, sample_time_s=STEP_S).table)
        current, distance = (table[name] for name in ("current_A", "distance_m"))
        current = current + generator.normal(0.0, 0.003, len(table))
        distance = 1e3 * (distance + generator.normal(0.0, 5e-6, len(table)))
        rows = {"time_s": table["time_s"].round(4), "voltage_V": table["voltage_V"].round(4)}
        runs.append(pd.DataFrame({"run": run, **rows, "current_A": current.round(4), "distance_mm": distance.round(4)}))
    return pd.concat(runs)


if __name__ == "__main__":
    solenoid_log(ff.read_model(sys.argv[1])).to_csv(LOG, index=False)
