"""Whatever is wrong with a file, a command ends in time with one line on it, and this process lives."""

import io
import zipfile

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat, wavfile

import femfit as ff
from femfit.model.json_file import write_model
from femfit.tables import containers
from support.command import femfit

DISTANCE = np.repeat([2e-3, 4e-3, 6e-3], 4)
CURRENT = np.tile([0.1, 0.4, 0.7, 1.0], 3)
BENCH = {"distance_m": DISTANCE, "current_A": CURRENT, "force_N": 3e-6 * (1.0 + CURRENT) / DISTANCE**2}
# Stands for HDF5's code in C where it runs in a circle: it holds the interpreter's lock, so that no signal is heard
DEAF = "from pathlib import Path\nPath({begun!r}).touch()\nimport ctypes\nctypes.PyDLL(None).sleep(60)\n"


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


def xlsx_file_of(columns):
    file = io.BytesIO()
    pd.DataFrame(columns).to_excel(file, index=False)
    return file.getvalue()


def flipped(content, seed, count):
    """The same bytes but so many."""
    rng = np.random.default_rng(seed)
    data = np.frombuffer(content, np.uint8).copy()
    places = rng.integers(0, len(data), count)
    data[places] = rng.integers(0, 256, count)
    return data.tobytes()


@pytest.fixture(scope="module")
def folder(levitation_model, tmp_path_factory):
    place = tmp_path_factory.mktemp("damage")
    write_model(levitation_model, place / "model.json")
    (place / "bench.h5").write_bytes(hdf5_file())
    return place


@pytest.fixture
def deaf(tmp_path):
    """A folder with an h5py that hangs, and the file that appears when it does."""
    (tmp_path / "h5py.py").write_text(DEAF.format(begun=str(tmp_path / "begun")))
    return tmp_path, tmp_path / "begun"


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
def test_a_damaged_file_of_matlab_or_hdf5_is_said_to_be_damaged(folder, monkeypatch, name, make, seed, count):
    monkeypatch.setattr(containers, "MEMORY", 1e9)
    (folder / name).write_bytes(flipped(make(), seed, count))
    done = femfit("compare", "model.json", name, cwd=folder)
    assert done.returncode == 1
    assert "damaged" in done.stderr
    assert name in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_a_file_that_hangs_its_library_is_given_up(folder, deaf, monkeypatch):
    monkeypatch.syspath_prepend(deaf[0])
    monkeypatch.setattr(containers, "TIMEOUT_S", 3.0)
    done = femfit("compare", "model.json", "bench.h5", cwd=folder)
    assert deaf[1].exists()
    assert done.returncode == 1
    assert "damaged" in done.stderr


def test_a_workbook_whose_xml_is_damaged_is_said_to_be_damaged(folder):
    good, bad = zipfile.ZipFile(io.BytesIO(xlsx_file_of(BENCH))), io.BytesIO()
    with zipfile.ZipFile(bad, "w") as book:
        for part in good.namelist():
            book.writestr(part, good.read(part).replace(b"</row>", b"</rwo>"))
    (folder / "bad.xlsx").write_bytes(bad.getvalue())
    done = femfit("compare", "model.json", "bad.xlsx", cwd=folder)
    assert done.returncode == 1
    assert "damaged" in done.stderr


@pytest.mark.parametrize(
    ("old", "new"), [(b'"name"', b'"nome"'), (b'"pandas_type"', b'"pandas_tipe"'), (b'"numpy_type"', b'"numpi_type"')]
)
def test_damaged_metadata_of_a_parquet_table_are_said(folder, old, new):
    time_s = np.arange(200) / 1000.0
    columns = {
        "coil_voltage_V": 0.0,
        "hall_T": time_s,
        "distance_m": 0.02,
        "current_A": np.arange(200) % 5,
        "force_N": 0.03,
    }
    columns["time_s"] = time_s
    pd.DataFrame(columns).to_parquet(folder / "bad.parquet")
    content = (folder / "bad.parquet").read_bytes()
    assert old in content
    (folder / "bad.parquet").write_bytes(content.replace(old, new))
    for command in ("compare model.json bad.parquet", "fit bad.parquet -o m.json", "integrate bad.parquet -o o.csv"):
        done = femfit(*command.split(), cwd=folder)
        assert done.returncode in {0, 1}, command
        assert "bug" not in done.stderr


def test_a_gain_is_a_number_in_the_sidecar_too(tmp_path):
    samples = np.round(2.0**14 * np.sin(np.arange(400))).astype(np.int16)
    wavfile.write(tmp_path / "a.wav", 1000, np.stack([samples, samples], axis=1))
    columns = {"channel 1": "current_A", "channel 2": "distance_m"}
    gains = {"channel 1": 10.0, "channel 2": 2}
    expected = ff.read_measurement(tmp_path / "a.wav", columns=columns, units=gains).rows
    lines = ["[columns]", *(f'"{key}" = "{name}"' for key, name in columns.items())]
    (tmp_path / "a.toml").write_text("\n".join([*lines, "[units]", *(f'"{k}" = {gain}' for k, gain in gains.items())]))
    read = ff.read_measurement(tmp_path / "a.wav").rows
    assert read["current_A"].abs().max() == pytest.approx(5.0, rel=1e-3)
    pd.testing.assert_frame_equal(read, expected)


def test_numbers_that_nobody_measures_are_no_impedances(tmp_path):
    (tmp_path / "a.csv").write_text("f [Hz],|Z|,theta\n1,1e300,1\n10,2,20\n100,3,25\n1e3,9,30\n")
    read = ff.read_measurement(tmp_path / "a.csv", settings={"distance_mm": 2.0})
    assert read.rows["resistance_ohm"].notna().sum() == 3
