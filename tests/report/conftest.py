"""A report's content without field solver and closed loop: analytic sweep, made-up field and study."""

import numpy as np
import pandas as pd
import pytest

from femfit.device.load import read_actuator, sweep_manifest_entry
from femfit.estimate.noise import ConsistencyBand
from femfit.fit.build import fit_model
from femfit.heat.find_temperatures import temperatures_at_supply
from femfit.report.field_sample import FieldSample
from femfit.report.page import ReportContent
from femfit.simulation.design import CONTROLLERS, design_loop
from femfit.simulation.experiment import Experiment
from femfit.simulation.loop import LoopResult, TimeSeries
from femfit.simulation.summary import ClosedLoopStudy, LoopSummary, Spread, StepRow
from femfit.tables.sweep_table import SweepTable
from support.actuators import GEOMETRY


def sweep_of(actuator, magnet=1.0):
    """Force, flux linkage and Hall field of one co-energy; magnet=0 leaves the part quadratic in the current."""
    axes = np.linspace(0.0, 1.4, 5), np.linspace(0.015, 0.045, 13)
    i, d = (grid.ravel() for grid in np.meshgrid(*axes, indexing="ij"))
    decay, length = np.exp(-d / 0.0166), 0.0166
    rows = {
        "current_A": i,
        "distance_m": d,
        "force_N": magnet * (4.19e-9 / d**4 + 0.2925 * decay * i) + (1 - magnet) * 0.5 * i**2 * decay,
        "flux_linkage_Wb": magnet * 0.2925 * length * decay * i**0 + (0.0162 + (1 - magnet) * length * decay) * i,
        "inductance_H": 0.0162 + (1 - magnet) * length * decay,
        "force_error_N": np.full_like(d, 2e-6),
        "status": np.full(len(d), "ok"),
    }
    if actuator.hall is not None:
        rows["hall_T"] = magnet * 8.6e-8 / (d + 0.0015) ** 3 + 0.004 * i
    manifest = {
        "kind": "sweep",
        "name": actuator.name,
        "actuator": sweep_manifest_entry(actuator),
        "settings": {"order": 5},
        "versions": {"femfit": "0.1.0", "ngsolve": "6.2"},
        "configuration_hash": "c0ffee" * 10,
    }
    return SweepTable(pd.DataFrame(rows), manifest)


def made_up_field(distance=0.022):
    """A dipole's flux: psi = m r^2 / (r^2 + (z - z0)^2)^(3/2), cut off inside of 4 mm."""
    radius, height = np.linspace(0.0, 0.031, 50), np.linspace(-0.036, 0.04, 120)
    r, z = np.meshgrid(radius, height)
    cubed = np.hypot(np.hypot(r, z - distance), 4e-3) ** 3
    largest = {"sleeve": 0.097, "magnet": 0.99}
    return FieldSample(distance, 0.32, radius, height, 6e-8 / cubed, 4e-7 * r**2 / cubed, 0.0427, largest, 11806)


def made_up_loop(design, controller, held, runs):
    """A loop over reference steps whose series are typed in; one that is lost is lost after 20 ms."""
    time = np.arange(300) * 5e-4
    path = 0.022 + 0.008 * np.clip((time - 0.05) / 0.05, 0.0, 1.0)
    noisy = path + 1e-5 * np.random.default_rng(0).standard_normal(len(time))
    still, amperes = 0.0 * path, np.full((len(time), 1), 0.4)
    arrays = (path, still, amperes, noisy, still, amperes, 1.0 + path[:, None], path[:, None], path, 1.0 + still)
    known = np.where((time < 0.02) | (held > 0), 1.0, np.nan)
    columns = [(known * array.T).T[:, None] for array in arrays]
    outcome = np.where(np.arange(runs) < held, 0, 2)
    result = LoopResult(time, TimeSeries(*columns), outcome, np.where(outcome, 0.02, np.nan), *[None] * 4)
    lost_s, nan = None if held == runs else 0.02, Spread(np.nan, np.nan)
    outcomes, band = {"HELD": held, "FELL": runs - held}, ConsistencyBand(0.98, 1.02)
    experiment = Experiment(controller, "ukf", design.targets_m)
    return LoopSummary(design, experiment, None, runs, 300, outcomes, lost_s, lost_s, nan, nan, 1.0, band, None, result)


def made_up_study(design, held=2, runs=2):
    """A study whose numbers are typed in; none held makes every mean NaN."""
    known = 1.0 if held else np.nan
    measured = (("direct", 1.46e-4), ("ukf", 2.66e-5))
    steps = tuple(StepRow(c, name, known * rms, held, runs) for c in CONTROLLERS for name, rms in measured)
    return ClosedLoopStudy(design, 7, tuple(made_up_loop(design, c, held, runs) for c in CONTROLLERS), steps)


@pytest.fixture(scope="session")
def rig_content():
    """A levitation rig with everything but laws."""
    actuator = read_actuator(GEOMETRY / "emaws-rig.toml")
    table = sweep_of(actuator)
    fit = fit_model(table)
    return ReportContent(
        model=fit.model,
        actuator=actuator,
        sweep=table,
        fit=fit,
        study=made_up_study(design_loop(fit.model)),
        field=made_up_field(),
        strongest=made_up_field(0.015),
        hashes=(("model.json", "ab" * 32),),
    )


@pytest.fixture(scope="session")
def plunger_content():
    """An actuator without magnet, Hall element, loop and laws, and without a sampled field."""
    actuator = read_actuator(GEOMETRY / "plunger-solenoid.toml")
    table = sweep_of(actuator, magnet=0.0)
    fit, heat = fit_model(table), temperatures_at_supply(actuator)
    return ReportContent(fit.model, actuator, table, fit, heat=heat, no_study="The model has no sensor.")


@pytest.fixture(scope="module")
def lost_study(rig_content):
    """A study in which no run was held."""
    return made_up_study(rig_content.study.design, held=0)


@pytest.fixture
def undrawn(monkeypatch):
    """Pages of which only the words and the names of the pictures are read."""
    monkeypatch.setattr("femfit.report.bench_report.svg_uri", lambda draw, name: "data:image/svg+xml,")
