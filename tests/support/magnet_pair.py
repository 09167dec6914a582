"""A pair of magnets without a coil: its force in closed form, its model and its bench."""

import numpy as np
import pandas as pd

from femfit.fit.build import fit_model
from femfit.tables.sweep_table import SweepTable

KIND = {"fixed_magnet": True, "moving_magnet": True, "fixed_iron": False, "moving_iron": False, "coil": False}


def force(distance):
    """Two disks of 10 mm that attract each other like charges on their faces, in N."""
    d = 1e3 * np.asarray(distance)
    return 400.0 * (1.0 / (d + 4.0) ** 2 - 1.4 / (d + 9.0) ** 2 + 0.5 / (d + 14.0) ** 2)


def magnet_pair(passed_m=0.0):
    """Its model, fitted to a sweep in distance, with the face moved into the fixed one by a length."""
    d = np.geomspace(0.2e-3, 20e-3, 24)
    rows = pd.DataFrame({"current_A": 0.0, "distance_m": d - passed_m, "force_N": force(d), "status": "ok"})
    entry = {"name": "pair", "mass_kg": 0.02, "gravity_m_s2": 0.0, "kind": {**KIND, "saturates": False}}
    return fit_model(SweepTable(rows, {"actuator": entry}), law="coenergy").model


def bench_csv(path, *, shift_m=0.0, passed_m=0.0, runs=3, noise_N=2e-3):
    """Write a bench table of distance and force, as somebody without a coil would."""
    generator, d = np.random.default_rng(5), np.linspace(0.5e-3, 18e-3, 12)
    lines = ["run,distance_mm,force_N"]
    for run in range(runs):
        read = force(d + shift_m) + generator.normal(0.0, noise_N, len(d))
        lines += [f"{run + 1},{1e3 * (one - passed_m):.4f},{value:.5f}" for one, value in zip(d, read, strict=True)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
