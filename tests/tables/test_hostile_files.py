"""Whatever stands in a file, a user reads one clear sentence of a sane size, within a second or two."""

import json
import subprocess
import sys

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from femfit.core.errors import TableError
from femfit.tables.coil_record import open_coil_record
from femfit.tables.foreign.options import ImportOptions
from femfit.tables.foreign.read import import_table, read_foreign_table
from femfit.tables.measurement_file import read_measurement
from femfit.tables.sweep_table import SweepTable, read_sweep_table, write_sweep_table

BENCH = "run,current_A,distance_m,force_N\n1,0.5,0.02,0.03\n1,1.0,0.02,0.04\n"
RECORD = "time_s,coil_voltage_V,hall_T\n" + "".join(f"{0.001 * k:.3f},{0.1 * k:.1f},0.5\n" for k in range(60))
SWEEP = pd.DataFrame({"current_A": [0.0, 1.0] * 3, "distance_m": [0.002, 0.004, 0.006] * 2, "force_N": [1.0] * 6})
DEEP = "[" * 5000


def said_by(function, *arguments):
    """What a user reads."""
    with pytest.raises(TableError) as caught:
        function(*arguments)
    return str(caught.value)


def blocks(path):
    return list(open_coil_record(path).blocks())


def written(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize(
    "line", [b"0.0695,1,2,3\x92\n", b'0.0695,"1,2,3\n', b"0.0695,1,2,3,4,5\n", b"0.0695,high,2\n", b"0.0695,\xff,2\n"]
)
def test_a_damaged_line_of_a_coil_record_is_said(tmp_path, line):
    assert "rec.csv" in said_by(blocks, written(tmp_path / "rec.csv", RECORD.encode() + line))


def test_a_damaged_page_of_a_parquet_record_is_said(tmp_path):
    time = np.arange(5000) / 1000.0
    table = pd.DataFrame({"time_s": time, "coil_voltage_V": np.random.default_rng(1).standard_normal(5000)})
    table.to_parquet(tmp_path / "rec.parquet", compression="snappy")
    content = bytearray((tmp_path / "rec.parquet").read_bytes())
    content[200:400] = bytes(200)
    assert "rec.parquet" in said_by(blocks, written(tmp_path / "rec.parquet", bytes(content)))


@pytest.mark.parametrize(
    "settings",
    [
        'start_s = "soon"',
        "start_s = [1]",
        f"start_s = {10**400}",
        "sample_rate_Hz = true",
        f"sample_rate_Hz = {10**400}",
        f"sample_rate_Hz = {'9' * 5000}",
        'columns = ["coil_voltage_V", "coil_voltage_V"]',
        "columns = [3]",
        f"columns = {DEEP}",
    ],
)
def test_a_raw_records_sidecar_is_checked(tmp_path, settings):
    np.zeros(8, "<f4").tofile(tmp_path / "r.bin")
    lines = {"sample_rate_Hz": "sample_rate_Hz = 10", "columns": 'columns = ["coil_voltage_V"]'}
    lines[settings.split(" = ")[0]] = settings
    (tmp_path / "r.toml").write_text("\n".join(lines.values()))
    assert len(said_by(open_coil_record, tmp_path / "r.bin")) < 700


@pytest.mark.parametrize("text", ["[1]", DEEP, "3", "{"])
def test_a_raw_records_json_sidecar_is_checked(tmp_path, text):
    np.zeros(8, "<f4").tofile(tmp_path / "r.bin")
    (tmp_path / "r.json").write_text(text)
    assert "r.json" in said_by(open_coil_record, tmp_path / "r.bin")


@pytest.mark.parametrize("noise", [f"force_N = 1{400 * '0'}", f"force_N = {'7' * 5000}", f"force_N = {DEEP}"])
def test_a_sidecars_noise_is_checked(tmp_path, noise):
    (tmp_path / "b.toml").write_text(noise)
    assert len(said_by(read_measurement, written(tmp_path / "b.csv", BENCH))) < 700


@pytest.mark.parametrize("manifest", ["[]", '{"actuator": 5}', DEEP, "3", "\x00"])
def test_a_manifest_is_checked(tmp_path, manifest):
    write_sweep_table(SweepTable(SWEEP), tmp_path)
    (tmp_path / "manifest.json").write_text(manifest)
    assert "manifest.json" in said_by(read_sweep_table, tmp_path)


@pytest.mark.parametrize("cell", ["x" * 140_000, "1" * 140_000, "(" * 100_000, "x" * 5000, "\x1b[31m"])
@pytest.mark.parametrize("place", ["header", "cell"])
def test_a_message_has_neither_the_size_nor_the_control_characters_of_the_input(tmp_path, cell, place):
    text = f"current_A;{cell};force_N\n1;2;3\n" if place == "header" else f"current_A;distance_m\n{cell};2\n1;{cell}\n"
    for function in (read_measurement, import_table):
        said = said_by(function, written(tmp_path / "t.csv", text))
        assert len(said) < 1000
        assert "\x1b" not in said


@pytest.mark.parametrize("columns", [20_000, 200_000])
def test_an_absurd_width_is_refused_for_that(tmp_path, columns):
    commas = "," * columns
    path = written(tmp_path / "t.csv", f"current_A,distance_m,force_N{commas}\n1,2,3{commas}\n")
    for function in (read_measurement, import_table, open_coil_record, read_sweep_table):
        said = said_by(function, path)
        assert "columns" in said or "characters" in said


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "cp1252", "utf-8-sig"])
@pytest.mark.parametrize(("delimiter", "decimal"), [(";", ","), (";", "."), ("\t", ","), (",", "."), (" ", ".")])
def test_coil_records_are_read_in_every_dialect(tmp_path, encoding, delimiter, decimal):
    rows = [[f"{0.5 * k:.4f}", f"{k % 7 - 3.25:.4f}", f"{k}"] for k in range(5000)]
    lines = [delimiter.join(row).replace(".", decimal) for row in rows]
    header = delimiter.join(["time_ms", "coil_voltage[mV]", "µ"])
    path = written(tmp_path / "r.csv", "\n".join([header, *lines, ""]).encode(encoding))
    record = open_coil_record(path)
    time, voltage = (np.concatenate([getattr(b, name) for b in record.blocks(999)]) for name in ("time", "voltage"))
    np.testing.assert_allclose(time, 5e-4 * np.arange(5000), rtol=1e-12)
    np.testing.assert_allclose(voltage, 1e-3 * (np.arange(5000) % 7 - 3.25), rtol=1e-12)


def test_moments_of_a_clock_are_seconds_from_the_first(tmp_path):
    time = np.arange(400) / 1000.0
    table = pd.DataFrame({"time_s": pd.to_datetime(1.7e9 + time, unit="s"), "coil_voltage_V": time, "current_A": time})
    table.to_parquet(tmp_path / "r.parquet")
    read = np.concatenate([block.time for block in open_coil_record(tmp_path / "r.parquet").blocks(150)])
    np.testing.assert_allclose(read, time, atol=1e-6)
    series = read_measurement(tmp_path / "r.parquet")
    np.testing.assert_allclose(series.rows["time_s"], time, atol=1e-6)


@pytest.mark.parametrize("manifest", [None, {"name": "of another program"}])
def test_a_sweep_table_in_millimetres_is_refused_with_the_remedy(tmp_path, manifest):
    SWEEP.assign(distance_m=1e3 * SWEEP["distance_m"]).to_csv(tmp_path / "t.csv", index=False)
    if manifest is not None:
        (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    assert "--unit distance_m=mm" in said_by(read_sweep_table, tmp_path / "t.csv")


POSITIONS = "\n".join(
    ",".join([f"{-k}", *(f"{-3.61531 * (1 + 0.31 * j) / (k + 2) ** 2:.6g}" for j in range(11))]) for k in range(20)
)


def test_a_headerless_list_of_positions_and_forces_is_no_matrix(tmp_path):
    path = written(tmp_path / "t.csv", POSITIONS)
    options = {"units": {"distance": "mm"}, "distance_start_m": 0.02}
    with pytest.raises(TableError, match="no header line"):
        import_table(path, **options)
    with pytest.raises(TableError, match="matrix-axis"):
        import_table(path, form="matrix", **options)
    small = written(tmp_path / "s.csv", "0,-0.1,-0.2,-0.3\n-1,-0.4,-0.5,-0.6\n-2,-0.7,-0.8,-0.9\n")
    with pytest.raises(TableError, match="no header line"):
        import_table(small, **options)


def test_the_currents_of_a_headerless_matrix_can_be_given(tmp_path):
    names = ("z [mm]", *(f"{0.2 * k:g} A" for k in range(11)))
    path = written(tmp_path / "t.csv", POSITIONS)
    table = read_foreign_table([path], ImportOptions(column_names=names, distance_start_m=0.025, accept=("units",)))
    assert table.rows["current_A"].nunique() == 11
    assert table.rows["distance_m"].nunique() == 20


def test_the_cell_that_is_no_number_is_shown(tmp_path):
    (tmp_path / "sweep.csv").write_text("distance_m,current_A,force_N\n0.01,0.5,1\n0.02,0.5,oops\n")
    with pytest.raises(TableError, match="'oops'"):
        read_sweep_table(tmp_path)


@pytest.fixture
def intact(tmp_path):
    columns = {"distance_mm": np.linspace(1.0, 3.0, 20), "current_A": np.ones(20), "force_N": np.linspace(3.0, 1.0, 20)}
    savemat(tmp_path / "table.mat", columns)
    return tmp_path / "table.mat"


def test_a_file_is_read_where_the_shell_limits_the_memory(intact):
    program = "import resource, sys, femfit; resource.setrlimit(resource.RLIMIT_AS, (1_700_000_000,) * 2); "
    program += "print(len(femfit.read_measurement(sys.argv[1]).rows))"
    done = subprocess.run([sys.executable, "-c", program, intact], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, "20"), done.stderr


def test_an_intact_file_that_needs_more_memory_is_not_called_damaged(intact):
    with h5py.File(intact.with_suffix(".h5"), "w") as file:  # 4 GB of zeros, of which no byte is written
        file.create_dataset("force_N", (500_000_000,), dtype="f8", chunks=True, compression="gzip")
    with pytest.raises(TableError, match="memory") as refused:
        read_measurement(intact.with_suffix(".h5"))
    assert "seems to be damaged" not in str(refused.value)


def test_readings_beyond_every_quantity_are_said_to_be_that(tmp_path):
    (tmp_path / "bench.csv").write_text("distance_mm,current_A,force_N\n3,0.4,1.5e199\n4,0.4,1.2e199\n")
    with pytest.raises(TableError, match=r"below 1e\+100 \('1\.5e199'\)"):
        read_measurement(tmp_path / "bench.csv")
