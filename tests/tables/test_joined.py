"""Several measurements taken together: the runs of each are its own."""

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import TableError
from femfit.tables.measurement import joined_measurements
from femfit.tables.measurement_file import read_measurement


def bench(path, runs=2, noise="", **columns):
    rows = pd.DataFrame({"distance_mm": [5.0, 6.0, 7.0] * runs, "force_N": np.arange(3.0 * runs)})
    rows.insert(0, "run", np.repeat(np.arange(1, runs + 1), 3))
    rows.assign(**columns).to_csv(path, index=False)
    if noise:
        path.with_suffix(".toml").write_text(f"[noise]\nforce_N = {noise}\n")
    return read_measurement(path)


def record(path, size=1.0):
    time = np.linspace(0.0, 0.5, 501)
    swing = size * np.sin(9.0 * time)
    rows = {"time_s": time, "current_A": 0.5 + 0.1 * swing, "distance_m": 0.02 + 1e-3 * swing}
    pd.DataFrame(rows).to_csv(path, index=False)
    return read_measurement(path)


def test_runs_mounts_and_segments_of_each_file_are_its_own(tmp_path):
    joined = joined_measurements([bench(tmp_path / "a.csv"), bench(tmp_path / "b.csv", 1, mount=7, current_A=0.5)])
    assert joined.rows["run"].tolist() == [1, 1, 1, 2, 2, 2, 3, 3, 3]
    assert joined.rows["mount"].tolist() == [1, 1, 1, 2, 2, 2, 3, 3, 3]
    assert joined.rows["force_N"].tolist() == [0, 1, 2, 3, 4, 5, 0, 1, 2]
    assert "current_A" in joined.given
    assert "a.csv and " in joined.source
    alone = bench(tmp_path / "a.csv")
    assert joined_measurements([alone]) is alone
    one, other = record(tmp_path / "a.csv"), record(tmp_path / "b.csv", 0.9)
    joined = joined_measurements([one, other])
    assert joined.rows["run"].nunique() == 2
    assert joined.rows["segment"].nunique() == one.rows["segment"].nunique() + other.rows["segment"].nunique()
    assert len(joined.rows) == len(one.rows) + len(other.rows)


def test_what_does_not_belong_together_is_refused(tmp_path):
    table = bench(tmp_path / "a.csv", noise="1e-3")
    with pytest.raises(TableError, match="bench tables"):
        joined_measurements([table, record(tmp_path / "log.csv")])
    with pytest.raises(TableError, match="noise"):
        joined_measurements([table, bench(tmp_path / "b.csv", noise="2e-3")])
    with pytest.raises(TableError, match="copy"):
        joined_measurements([table, bench(tmp_path / "copy.csv", noise="1e-3")])
    with pytest.raises(TableError, match="measurement"):
        joined_measurements([])
