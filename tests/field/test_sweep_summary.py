"""What a sweep's summary says of its errors."""

import pandas as pd
import pytest

from femfit.device.parts import NonlinearMaterial
from femfit.field.sweep import run_sweep
from femfit.field.sweep_rows import summarise
from femfit.field.tolerance import SolverSettings
from femfit.tables.sweep_table import SweepTable
from support.saturating import bobbin


def table(forces, errors, manifest=None):
    rows = pd.DataFrame({"current_A": [0.0, 1.0, 2.0], "distance_m": 0.01, "force_N": forces, "force_error_N": errors})
    return SweepTable(rows.assign(status="ok"), manifest or {})


def test_a_force_that_crosses_zero_is_measured_by_that_of_the_weakest_current():
    summary = summarise(table([0.1, 1e-9, -0.2], [1e-5, 2e-5, 2e-5]))
    assert summary["force_error_relative_max"] == pytest.approx(2e-4)


def test_a_force_that_crosses_zero_along_the_distance_is_measured_by_those_on_both_sides():
    rows = pd.DataFrame({"current_A": 1.0, "distance_m": [0.03, 0.01, 0.02], "force_N": [-0.1, 0.2, 1e-9]})
    rows = rows.assign(force_error_N=[1e-5, 2e-5, 4e-5], status="ok")
    assert summarise(SweepTable(rows, {}))["force_error_relative_max"] == pytest.approx(4e-5 / 0.1)
    tolerant = SweepTable(rows, {"settings": {"tolerance": 1e-2}})
    assert summarise(tolerant)["rows_beyond_tolerance"] == 1  # a tolerance is met at each distance on its own


def test_rows_without_any_force_have_no_relative_error():
    assert summarise(table([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]))["force_error_relative_max"] == 0.0
    assert summarise(table([0.0, 0.1, 0.4], [0.0, 1e-4, 2e-4]))["force_error_relative_max"] == pytest.approx(1e-3)


def test_rows_that_miss_the_tolerance_are_counted():
    manifest = {"settings": {"tolerance": 1.5e-4}}
    assert summarise(table([0.1, 0.1, 0.1], [1e-5, 2e-5, 3e-5], manifest))["rows_beyond_tolerance"] == 2
    assert "rows_beyond_tolerance" not in summarise(table([0.1, 0.1, 0.1], [1e-5, 2e-5, 3e-5]))


def test_points_beyond_the_end_of_a_curve_are_counted(tmp_path):
    short = NonlinearMaterial("short", (0.0, 0.5, 0.8), (0.0, 400.0, 2000.0))
    swept = run_sweep(bobbin(short, currents=(0.0, 8.0)), tmp_path, workers=1, settings=SolverSettings(order=3))
    assert swept.manifest["points_beyond_bh_curve"] == 1  # 8 A drive the sleeve far beyond 0.8 T, 0 A nowhere
    assert summarise(swept)["points_beyond_bh_curve"] == 1


def test_a_force_that_is_zero_at_every_distance_without_current_is_no_measure_of_its_error():
    rows = pd.DataFrame(
        {
            "current_A": [0.0, 0.0, 1.0, 1.0],
            "distance_m": [0.01, 0.02, 0.01, 0.02],
            "force_N": [1e-9, 1e-9, 1.0, 0.5],
            "force_error_N": [1e-8, 1e-8, 1e-4, 1e-4],
            "status": ["ok"] * 4,
        }
    )
    # 1e-8 N over 1e-9 N would be 1000 %, of a force that nobody misses
    assert summarise(SweepTable(rows, {}))["force_error_relative_max"] == pytest.approx(2e-4)
