"""Every kind of file that a lab has: MAT, XLSX, HDF5, TDMS and WAV, read like CSV."""

import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import h5py
import numpy as np
import pandas as pd
import pytest
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat, wavfile

from femfit.core.errors import TableError
from femfit.tables.foreign import import_table
from femfit.tables.measurement import TimeSeries
from femfit.tables.measurement_file import read_measurement
from support.expected import unmentioned
from support.small_records import BENCH

DISTANCE, CURRENT, FORCE = BENCH.values()
LAB = {"Luftspalt [mm]": 1e3 * DISTANCE, "Strom [A]": CURRENT, "Kraft [N]": FORCE}
TIME = 1e-3 * np.arange(50)
RECORD = {
    "time_s": TIME,
    "current_A": 0.5 + 0.1 * np.sin(300.0 * TIME),
    "distance_m": 4e-3 + 1e-4 * np.cos(90.0 * TIME),
}


@pytest.fixture(autouse=True)
def _decoded_here(monkeypatch):
    """A process for each MAT and HDF5 file takes 0.3 s: tests of damaged files have their own."""
    monkeypatch.setattr("femfit.tables.containers.process_pool", ThreadPoolExecutor)
    monkeypatch.setattr("resource.setrlimit", lambda *_: None)


def each(tables):
    return [(name, header, values) for name, columns in tables.items() for header, values in columns.items()]


def write_mat(path, tables):
    savemat(path, tables.get("", {}) | {name: columns for name, columns in tables.items() if name})


@contextmanager
def version_73(path):
    """A file as MATLAB's -v7.3 writes it."""
    with h5py.File(path, "w", userblock_size=512) as file:
        yield file
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")


def write_mat73(path, tables):
    """Columns as (1, n), structs as groups."""
    with version_73(path) as file:
        for name, header, values in each(tables):
            data = file.create_dataset(f"{name}/{header}", data=np.asarray(values)[None, :])
            data.attrs["MATLAB_class"] = np.bytes_("double")


def write_hdf5(path, tables):
    with h5py.File(path, "w") as file:
        for name, header, values in each(tables):
            file[f"{name}/{header}"] = values


def write_tdms(path, tables):
    with TdmsWriter(path) as file:
        file.write_segment([ChannelObject(*one) for one in each(tables)])


def write_xlsx(path, tables):
    with pd.ExcelWriter(path) as book:
        for name, columns in tables.items():
            pd.DataFrame(columns).to_excel(book, sheet_name=name or "Sheet1", index=False)


WRITERS = {"a.mat": write_mat, "v73.mat": write_mat73, "a.h5": write_hdf5, "a.tdms": write_tdms, "a.xlsx": write_xlsx}
OTHER = {"channel_1": np.arange(5.0), "channel_2": np.arange(5.0)}


@pytest.mark.parametrize("name", WRITERS)
def test_the_table_that_has_the_columns_is_taken_and_of_several_the_user_chooses(tmp_path, name):
    path = tmp_path / name
    WRITERS[name](path, {"bench": BENCH, "other": OTHER})
    read = read_measurement(path)
    for column, values in BENCH.items():
        np.testing.assert_allclose(read.rows[column], values, rtol=1e-12)
    (choice,) = (one.text for one in read.findings)
    assert not unmentioned(["'bench'", "other"], choice)
    WRITERS[name](path, {"first": BENCH, "second": BENCH | {"force_N": 2.0 * FORCE}})
    for table in (None, "third"):
        with pytest.raises(TableError, match=r"(?s)first: .*force_N.*second.*--table"):
            read_measurement(path, table=table)
    np.testing.assert_allclose(read_measurement(path, table="second").rows["force_N"], 2.0 * FORCE)
    WRITERS[name](path, {"one": OTHER, "two": {"p": np.arange(4.0), "q": np.arange(4.0)}})
    with pytest.raises(TableError, match=r"(?s)one.*channel_1.*two.*p, q.*--table"):
        read_measurement(path)


@pytest.mark.parametrize("name", ["a.h5", "a.tdms", "a.xlsx", "a.parquet"])
def test_units_stand_in_the_headers_of_any_kind_of_file(tmp_path, name):
    path = tmp_path / name
    if name == "a.parquet":
        pd.DataFrame(LAB).to_parquet(path)
    else:
        WRITERS[name](path, {"bench": LAB})
    np.testing.assert_allclose(read_measurement(path).rows["distance_m"], DISTANCE)
    np.testing.assert_allclose(sorted(import_table(path).rows["distance_m"]), DISTANCE)


@pytest.mark.parametrize("name", ["a.mat", "v73.mat", "a.h5"])
def test_variables_at_the_top_are_a_table_and_a_clock_there_is_common_to_the_groups_below(tmp_path, name):
    signals = {key: values for key, values in RECORD.items() if key != "time_s"}
    for tables in ({"": RECORD}, {"": {"time_s": TIME}, "signals": signals}):
        WRITERS[name](tmp_path / name, tables)
        read = read_measurement(tmp_path / name)
        assert isinstance(read, TimeSeries)
        np.testing.assert_allclose(read.rows[list(RECORD)], np.column_stack(list(RECORD.values())))


def same_bench(read):
    frame = read.rows.sort_values(["distance_m", "current_A"])
    np.testing.assert_allclose(frame["force_N"], FORCE)
    np.testing.assert_allclose(frame["current_A"], CURRENT)


def test_a_scope_of_simulink_is_a_table(tmp_path):
    signals = [{"label": key, "values": values[:, None]} for key, values in RECORD.items() if key != "time_s"]
    scope = {"time": TIME[:, None], "signals": signals, "blockName": "loop/Scope"}
    savemat(tmp_path / "scope.mat", {"ScopeData": scope})
    read = read_measurement(tmp_path / "scope.mat")
    np.testing.assert_allclose(read.rows["current_A"], RECORD["current_A"])


@pytest.mark.parametrize(
    "variables",
    [
        {"rows": [dict(zip(BENCH, row, strict=True)) for row in zip(*BENCH.values(), strict=True)]},
        {"data": np.column_stack(list(BENCH.values())), "colheaders": np.array(list(BENCH), dtype=object)},
        {"chan": [{"Name": key, "Data": values} for key, values in BENCH.items()]},
    ],
    ids=["array of structs", "matrix and names", "named channels"],
)
def test_structs_and_cells_of_matlab_are_tables(tmp_path, variables):
    savemat(tmp_path / "a.mat", variables)
    same_bench(read_measurement(tmp_path / "a.mat"))


def test_a_matrix_without_names_is_read_by_number(tmp_path):
    savemat(tmp_path / "a.mat", {"M": np.column_stack(list(BENCH.values()))})
    columns = {f"M column {k + 1}": name for k, name in enumerate(BENCH)}
    same_bench(read_measurement(tmp_path / "a.mat", columns=columns))


def test_struct_arrays_texts_and_cells_of_version_73_are_read(tmp_path):
    with version_73(tmp_path / "a.mat") as file:
        hidden, group = file.create_group("#refs#"), file.create_group("log/signals")
        names, values = [], []
        for k, (key, column) in enumerate(BENCH.items()):
            text = hidden.create_dataset(f"n{k}", data=np.array([[ord(letter)] for letter in key], dtype=np.uint16))
            text.attrs["MATLAB_class"] = np.bytes_("char")
            names.append(text.ref)
            values.append(hidden.create_dataset(f"v{k}", data=column[None, :]).ref)
        for field, references in (("label", names), ("values", values)):
            group.create_dataset(field, data=np.array([references], dtype=h5py.ref_dtype), dtype=h5py.ref_dtype)
    same_bench(read_measurement(tmp_path / "a.mat"))


def test_compound_data_sets_and_units_as_attributes_are_read(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["bench"] = pd.DataFrame(BENCH).to_records(index=False)
    same_bench(read_measurement(tmp_path / "a.h5"))
    columns = {"gap": (1e3 * DISTANCE, "mm"), "current": (CURRENT, "A"), "force": (1e3 * FORCE, "mN")}
    with h5py.File(tmp_path / "b.h5", "w") as file:
        for name, (values, unit) in columns.items():
            file.create_dataset(name, data=values).attrs["unit"] = unit
    same_bench(read_measurement(tmp_path / "b.h5"))


def test_the_increment_of_a_waveform_is_its_time(tmp_path):
    clock = {"wf_increment": 1e-3, "wf_start_offset": 0.2}
    with TdmsWriter(tmp_path / "a.tdms") as file:
        current = ChannelObject("log", "Strom", 1e3 * RECORD["current_A"], properties=clock | {"unit_string": "mA"})
        file.write_segment([current, ChannelObject("log", "hall_V", RECORD["distance_m"], properties=clock)])
    read = read_measurement(tmp_path / "a.tdms")
    assert isinstance(read, TimeSeries)
    np.testing.assert_allclose(read.rows["time_s"], 0.2 + TIME)
    np.testing.assert_allclose(read.rows["current_A"], RECORD["current_A"])


def test_a_sheet_may_have_a_title_units_below_the_names_and_a_sum(tmp_path):
    rows = [["Messprotokoll", None, None], [None] * 3, ["Luftspalt", "Strom", "Kraft"], ["mm", "A", "g"]]
    rows += [[1e3 * d, i, f / 9.80665e-3] for d, i, f in zip(DISTANCE, CURRENT, FORCE, strict=True)]
    with pd.ExcelWriter(tmp_path / "a.xlsx") as book:
        pd.DataFrame([["Deckblatt"]]).to_excel(book, sheet_name="Info", index=False, header=False)
        pd.DataFrame([*rows, ["Summe", None, 1.0]]).to_excel(book, sheet_name="Daten", index=False, header=False)
    same_bench(read_measurement(tmp_path / "a.xlsx"))


@pytest.mark.parametrize(
    ("kind", "full", "step"),
    [(np.uint8, 128, 1 / 128), (np.int16, 2**15, 2**-15), (np.int32, 2**31, 2**-31), (np.float32, 1, 2**-24)],
)
def test_a_recording_is_scaled_to_full_scale_and_timed_by_its_rate(tmp_path, kind, full, step):
    signal = 0.5 * np.sin(2.0 * np.pi * 50.0 * np.arange(400) / 8000.0)
    samples = signal * full + (128 if kind is np.uint8 else 0)
    samples = samples if kind is np.float32 else np.rint(samples)
    wavfile.write(tmp_path / "a.wav", 8000, np.column_stack([samples, samples]).astype(kind))
    columns = {"channel 1": "current_A", "channel 2": "hall_V"}
    read = read_measurement(tmp_path / "a.wav", columns=columns, units={"channel 2": "2.5"})
    np.testing.assert_allclose(np.diff(read.rows["time_s"]), 1 / 8000.0)
    np.testing.assert_allclose(read.rows["current_A"], signal, atol=step)
    np.testing.assert_allclose(read.rows["hall_V"], 2.5 * signal, atol=2.5 * step)


@pytest.mark.parametrize(("name", "package"), [("a.xlsx", "openpyxl"), ("a.h5", "h5py"), ("a.tdms", "nptdms")])
def test_a_missing_library_is_named_with_its_remedy(tmp_path, monkeypatch, name, package):
    WRITERS[name](tmp_path / name, {"bench": BENCH})
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(TableError, match=rf"(?i){package}.*femfit\[files\]"):
        read_measurement(tmp_path / name)
