"""Whatever is wrong with a file, a command ends in time with one line on it, and this process lives."""

import io

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from femfit.tables import containers
from support.command import femfit
from support.small_records import BENCH


def mat_file():
    file = io.BytesIO()
    savemat(file, {"bench": BENCH})
    return file.getvalue()


def hdf5_file():
    file = io.BytesIO()
    with h5py.File(file, "w") as book:
        for name, values in BENCH.items():
            data = book.create_dataset(f"bench/{name}", data=values, chunks=(4,), compression="gzip", maxshape=(None,))
            data.attrs["unit"] = "m"
    return file.getvalue()


def flipped(content, seed, count):
    """The same bytes but so many."""
    rng = np.random.default_rng(seed)
    data = np.frombuffer(content, np.uint8).copy()
    places = rng.integers(0, len(data), count)
    data[places] = rng.integers(0, 256, count)
    return data.tobytes()


# Seeds with which SciPy 1.17 and h5py 3.16 end the process by SIGBUS or SIGSEGV, or by filling its memory
@pytest.mark.parametrize(
    ("name", "make", "seed", "count"),
    [
        ("sigbus.mat", mat_file, 98, 8),
        ("sigsegv.mat", mat_file, 108, 8),
        ("endless.mat", mat_file, 137, 8),
        ("sigsegv.h5", hdf5_file, 4088, 3),
        ("endless.h5", hdf5_file, 1827, 3),
    ],
)
def test_a_damaged_file_of_matlab_or_hdf5_is_said_to_be_damaged(model_file, monkeypatch, name, make, seed, count):
    monkeypatch.setattr(containers, "MEMORY", 1e9)
    (model_file.parent / name).write_bytes(flipped(make(), seed, count))
    done = femfit("compare", "model.json", name, cwd=model_file.parent)
    assert done.returncode == 1
    assert "damaged" in done.stderr
    assert name in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_file_that_hangs_its_library_is_given_up(model_file, monkeypatch):
    (model_file.parent / "bench.h5").write_bytes(hdf5_file())
    monkeypatch.setattr(containers, "TIMEOUT_S", 0.01)  # no library can be loaded in that
    done = femfit("compare", "model.json", "bench.h5", cwd=model_file.parent)
    assert done.returncode == 1
    assert "damaged" in done.stderr


@pytest.mark.parametrize(
    ("old", "new"), [(b'"name"', b'"nome"'), (b'"pandas_type"', b'"pandas_tipe"'), (b'"numpy_type"', b'"numpi_type"')]
)
def test_damaged_metadata_of_a_parquet_table_are_said(model_file, old, new):
    time_s, path = np.arange(200) / 1000.0, model_file.with_name("bad.parquet")
    columns = {"coil_voltage_V": 0.0, "hall_T": time_s, "distance_m": 0.02, "current_A": np.arange(200) % 5}
    pd.DataFrame({**columns, "force_N": 0.03, "time_s": time_s}).to_parquet(path)
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new))
    for command in ("compare model.json bad.parquet", "fit bad.parquet -o m.json", "integrate bad.parquet -o o.csv"):
        done = femfit(*command.split(), cwd=path.parent)
        assert done.returncode in {0, 1}, command
        assert "bug" not in done.stderr
