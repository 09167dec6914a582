"""Coil records in every format give the same blocks; what cannot be used is named."""

import numpy as np
import pandas as pd
import pytest
from scipy.io import wavfile

from femfit.core.errors import TableError
from femfit.integrate.integrate_coil import record_writer
from femfit.tables.coil_record import open_coil_record
from femfit.tables.measurement_file import read_measurement


@pytest.fixture
def table():
    rng = np.random.default_rng(1)
    time = np.arange(1000) / 1000.0
    # Values that float32 holds exactly, so that the raw format loses nothing.
    return pd.DataFrame(
        {"time_s": time, "coil_voltage_V": np.float32(rng.normal(size=1000)), "hall_T": np.float32(np.sin(time))}
    ).astype(np.float64)


def written(table, path):
    if path.suffix in {".csv", ".parquet"}:
        with record_writer(path, list(table.columns)) as write:
            for rows in np.array_split(np.arange(len(table)), 3):
                write(table.iloc[rows])
    else:
        table.drop(columns="time_s").to_numpy("<f4").tofile(path)
        side = 'sample_rate_Hz = 1000\ncolumns = ["coil_voltage_V", "hall_T"]\n'
        path.with_suffix(".toml").write_text(side)
    return path


@pytest.mark.parametrize("name", ["a.csv", "a.parquet", "a.bin", "a.raw", "a.f32"])
def test_what_is_written_is_read_in_blocks(name, table, tmp_path):
    record = open_coil_record(written(table, tmp_path / name))
    assert record.columns == ("coil_voltage_V", "hall_T")
    assert record.samples in {1000, None}
    blocks = list(record.blocks(rows=300))
    assert [len(block) for block in blocks] == [300, 300, 300, 100]
    for column, values in (("time_s", "time"), ("coil_voltage_V", "voltage"), ("hall_T", "hall")):
        read = np.concatenate([getattr(block, values) for block in blocks])
        # CSV keeps ten digits.
        np.testing.assert_allclose(read, table[column], rtol=1e-9, atol=1e-12)
    assert all(block.current is None for block in blocks)


def test_what_is_not_used_of_a_record_is_said(table, tmp_path):
    table.loc[::4, "coil_voltage_V"] = np.nan
    table.loc[3, "coil_voltage_V"] = 1.42e21
    record = open_coil_record(written(table.rename(columns={"hall_T": "hall_xT"}), tmp_path / "a.csv"))
    assert sum(map(len, record.blocks(rows=300))) == 749
    assert [str(remark) for remark in record.findings] == [
        "Not used: hall_xT. Where one is meant, say --column hall_xT=hall_T.",
        "250 samples of coil_voltage_V are missing.",
        "1 sample of coil_voltage_V is beyond what is possible and counts as missing.",
    ]
    with pytest.raises(TableError, match="holds one table"):
        open_coil_record(tmp_path / "a.csv", table="x")


def test_a_sound_card_records_a_coil(tmp_path):
    samples = np.rint(2**14 * np.sin(0.1 * np.arange(900)))
    wavfile.write(tmp_path / "a.wav", 44100, samples.astype(np.int16))
    record = open_coil_record(tmp_path / "a.wav", columns={"channel 1": "coil_voltage_V"}, units={"channel 1": "1.5"})
    blocks = list(record.blocks(rows=300))
    assert [len(block) for block in blocks] == [300, 300, 300]
    assert record.samples == 900
    np.testing.assert_allclose(np.concatenate([block.voltage for block in blocks]), 1.5 * samples / 2**15)
    np.testing.assert_allclose(np.concatenate([block.time for block in blocks]), np.arange(900) / 44100.0)


@pytest.mark.parametrize(
    ("encoding", "delimiter", "decimal"),
    [("utf-16", *marks) for marks in ((";", ","), (";", "."), ("\t", ","), (",", "."), (" ", "."))]
    + [(encoding, ";", ",") for encoding in ("cp1252", "utf-8-sig")],
)
def test_coil_records_are_read_in_every_dialect(tmp_path, encoding, delimiter, decimal):
    rows = [[f"{0.5 * k:.4f}", f"{k % 7 - 3.25:.4f}", f"{k}"] for k in range(1500)]
    lines = [delimiter.join(row).replace(".", decimal) for row in rows]
    header = delimiter.join(["time_ms", "coil_voltage[mV]", "µ"])
    (tmp_path / "r.csv").write_bytes("\n".join([header, *lines, ""]).encode(encoding))
    blocks = list(open_coil_record(tmp_path / "r.csv").blocks(999))
    time, voltage = (np.concatenate([getattr(block, name) for block in blocks]) for name in ("time", "voltage"))
    np.testing.assert_allclose(time, 5e-4 * np.arange(1500), rtol=1e-12)
    np.testing.assert_allclose(voltage, 1e-3 * (np.arange(1500) % 7 - 3.25), rtol=1e-12)


@pytest.mark.parametrize("kind", ["datetime64[us]", "timedelta64[us]"])
@pytest.mark.parametrize("rows", [300, 2**18])
def test_a_clock_of_moments_counts_from_the_first_one_that_is_known(kind, rows, table, tmp_path):
    moments = pd.Series((1e6 * table["time_s"] + 5e6).round().astype("int64")).astype(kind)
    moments[:3] = pd.NaT
    moments[500] = pd.NaT
    table.assign(time_s=moments).to_parquet(tmp_path / "a.parquet")
    blocks = list(open_coil_record(tmp_path / "a.parquet").blocks(rows=rows))
    time = np.concatenate([block.time for block in blocks])
    np.testing.assert_allclose(time, np.delete(np.arange(3, 1000), 497) / 1000 - 0.003, atol=1e-12)
    table.assign(time_s=moments, current_A=1.0).drop(columns="coil_voltage_V").to_parquet(tmp_path / "b.parquet")
    series = read_measurement(tmp_path / "b.parquet").rows["time_s"]
    np.testing.assert_allclose(series - series.iloc[0], time, atol=1e-6)
