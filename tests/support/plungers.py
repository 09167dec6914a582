"""Sweeps of three plungers that saturate, and the network that is fitted to each once."""

from functools import cache
from pathlib import Path

import pandas as pd

from femfit.fit.rows import rows_of_table
from femfit.fit.soft_iron import fit_network
from femfit.tables.sweep_table import SweepTable

SWEEPS = pd.read_csv(Path(__file__).parents[1] / "fit" / "saturating_plungers.csv", comment="#")
DEVICES = ("push", "pull", "relay")
ENTRY = {"name": "plunger", "mass_kg": 0.03, "resistance_ohm": 15.0, "voltage_min_V": 0.0, "voltage_max_V": 12.0}


def plunger_table(device):
    rows = SWEEPS[SWEEPS["device"] == device].drop(columns="device")
    rows = rows.assign(distance_m=1e-3 * rows["distance_mm"], status="ok").drop(columns="distance_mm")
    return SweepTable(rows.reset_index(drop=True), {"actuator": ENTRY})


@cache
def network_of(device):
    rows = rows_of_table(plunger_table(device))
    return rows, fit_network(rows)
