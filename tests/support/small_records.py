"""Records of a loop, and of a coil's voltage, as short as they may be."""

import numpy as np
import pandas as pd


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
