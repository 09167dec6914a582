"""Records of a loop, of a coil's voltage and of a bench, as short as they may be."""

import numpy as np
import pandas as pd

DISTANCE_M, CURRENT_A = np.repeat([2e-3, 4e-3, 6e-3], 4), np.tile([0.1, 0.4, 0.7, 1.0], 3)
BENCH = {"distance_m": DISTANCE_M, "current_A": CURRENT_A, "force_N": 3e-6 * (1.0 + CURRENT_A) / DISTANCE_M**2}
"""Columns."""


def loop_record(path, seconds, hertz):
    time = np.arange(0.0, seconds, 1e-3)
    swing = np.sin(2 * np.pi * hertz * time)
    loop = {"time_s": time, "distance_m": 0.022 + 1e-3 * swing, "current_A": 0.4 + 0.1 * swing}
    pd.DataFrame(loop | {"hall_V": 2.6 + 0.01 * swing}).to_csv(path, index=False)
    return path


def coil_record(path, seconds):
    time = np.arange(0.0, seconds, 1e-3)
    field = 0.1 * (1.0 - np.cos(2 * np.pi * time))
    coil = {"time_s": time, "coil_voltage_V": 0.05 * np.gradient(field, time) + 1e-5, "hall_T": field}
    pd.DataFrame(coil).to_csv(path, index=False)
    return path
