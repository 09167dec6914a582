"""Coil records in every format give the same blocks, by whatever words a user says; what cannot be used is named."""

import numpy as np
import pandas as pd
import pytest
from scipy.io import wavfile

from femfit.core.errors import TableError
from femfit.integrate.bench_table import make_bench_table
from femfit.integrate.integrate_coil import integrate_coil, record_writer
from femfit.tables.coil_record import open_coil_record
from femfit.tables.measurement_file import read_measurement

TIME = np.arange(1000) / 1000.0
# Values that float32 holds exactly, so that the raw format loses nothing
READ = {"coil_voltage_V": np.float32(np.random.default_rng(1).normal(size=1000)), "hall_T": np.float32(np.sin(TIME))}
TABLE = pd.DataFrame({"time_s": TIME, **READ}).astype(np.float64)


def joined(blocks, name):
    return np.concatenate([getattr(block, name) for block in blocks])


def written(path):
    if path.suffix in {".csv", ".parquet"}:
        with record_writer(path, list(TABLE.columns)) as write:
            for rows in np.array_split(np.arange(len(TABLE)), 3):
                write(TABLE.iloc[rows])
    else:
        TABLE.drop(columns="time_s").to_numpy("<f4").tofile(path)
        path.with_suffix(".toml").write_text('sample_rate_Hz = 1000\ncolumns = ["coil_voltage_V", "hall_T"]\n')
    return path


@pytest.mark.parametrize("name", ["a.csv", "a.parquet", "a.bin", "a.raw", "a.f32"])
def test_what_is_written_is_read_in_blocks(name, tmp_path):
    record = open_coil_record(written(tmp_path / name))
    assert record.columns == ("coil_voltage_V", "hall_T")
    assert record.samples in {1000, None}
    blocks = list(record.blocks(rows=300))
    assert [len(block) for block in blocks] == [300, 300, 300, 100]
    for column, values in (("time_s", "time"), ("coil_voltage_V", "voltage"), ("hall_T", "hall")):
        # CSV keeps ten digits.
        np.testing.assert_allclose(joined(blocks, values), TABLE[column], rtol=1e-9, atol=1e-12)
    assert all(block.current is None for block in blocks)


def test_what_is_not_used_of_a_record_is_said(tmp_path):
    table = TABLE.rename(columns={"hall_T": "hall_xT"})
    table.loc[::4, "coil_voltage_V"] = np.nan
    table.loc[3, "coil_voltage_V"] = 1.42e21
    table.to_csv(tmp_path / "a.csv", index=False)
    record = open_coil_record(tmp_path / "a.csv")
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
    np.testing.assert_allclose(joined(blocks, "voltage"), 1.5 * samples / 2**15)
    np.testing.assert_allclose(joined(blocks, "time"), np.arange(900) / 44100.0)


@pytest.mark.parametrize("kind", ["datetime64[us]", "timedelta64[us]"])
@pytest.mark.parametrize("rows", [300, 2**18])
def test_a_clock_of_moments_counts_from_the_first_one_that_is_known(kind, rows, tmp_path):
    moments = pd.Series((1e6 * TABLE["time_s"] + 5e6).round().astype("int64")).astype(kind)
    moments[:3] = pd.NaT
    moments[500] = pd.NaT
    TABLE.assign(time_s=moments).to_parquet(tmp_path / "a.parquet")
    time = joined(open_coil_record(tmp_path / "a.parquet").blocks(rows=rows), "time")
    np.testing.assert_allclose(time, np.delete(np.arange(3, 1000), 497) / 1000 - 0.003, atol=1e-12)
    TABLE.assign(time_s=moments, current_A=1.0).drop(columns="coil_voltage_V").to_parquet(tmp_path / "b.parquet")
    series = read_measurement(tmp_path / "b.parquet").rows["time_s"]
    np.testing.assert_allclose(series - series.iloc[0], time, atol=1e-6)


COIL = pd.DataFrame({"time_s": TIME, "coil_voltage_V": 0.05 * np.cos(TIME), "current_A": np.sin(TIME)})


def test_a_coil_record_has_a_sidecar_and_one_in_memory_takes_the_same_words(tmp_path):
    named = COIL.rename(columns={"coil_voltage_V": "Kanal 1"}).assign(**{"Kanal 1": 1e3 * COIL["coil_voltage_V"]})
    named.to_csv(tmp_path / "r.csv", index=False)
    words = {"columns": {"Kanal 1": "coil_voltage_V"}, "units": {"Kanal 1": "mV"}}
    value = integrate_coil(COIL, method="trapezoid").value
    assert integrate_coil(named, method="trapezoid", **words).value == pytest.approx(value)
    assert integrate_coil(tmp_path / "r.csv", method="trapezoid", **words).value == pytest.approx(value)
    (tmp_path / "r.toml").write_text('[columns]\n"Kanal 1" = "coil_voltage_V"\n[units]\n"Kanal 1" = "mV"\n')
    (block,) = open_coil_record(tmp_path / "r.csv").blocks()
    np.testing.assert_allclose(block.voltage, COIL["coil_voltage_V"])
    named.assign(distance_mm=5.0).to_csv(tmp_path / "r.csv", index=False)
    with pytest.raises(TableError, match="The current changes slowly"):  # it found its columns
        make_bench_table(tmp_path / "r.csv")


@pytest.mark.parametrize("options", [{"units": {3: "mm"}}, {"noise": {1: 2.0}}])
def test_names_that_are_no_texts_are_refused_with_what_is_needed(tmp_path, options):
    (path := tmp_path / "t.csv").write_text("distance_mm,current_A,force_N\n5,0,0.2\n6,0,0.1\n")
    with pytest.raises(TableError, match=f"{next(iter(options))} must hold lines like"):
        read_measurement(path, **options)
    COIL.to_csv(path, index=False)
    with pytest.raises(TableError, match=r"lacks time_s|is not a unit of column"):
        open_coil_record(path, units={"time_s": 1e-300})


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("initial_field_T", np.nan),
        ("initial_field_T", -1e300),
        ("coil_area_m2", 1e-300),
        ("coil_area_sigma_m2", -1.0),
        ("offset_sigma_V", 1e300),
        ("offset_sigma_V", "x"),
        ("coverage", 0.0),
    ],
)
def test_an_option_of_an_integral_that_is_no_such_number_is_refused(option, value):
    with pytest.raises(TableError, match="must be"):
        integrate_coil(COIL, method="ffa2", **{option: value})


def test_two_columns_of_one_name_and_steps_of_no_clock_are_refused_by_the_name_of_the_record():
    doubled = pd.concat([COIL, COIL[["current_A"]]], axis=1)
    with pytest.raises(TableError, match="the table has more than one column named current_A"):
        integrate_coil(doubled, method="trapezoid")
    with pytest.raises(TableError, match="the table jumps back"):
        integrate_coil(COIL.assign(time_s=1e-320 * np.arange(len(COIL))), method="trapezoid")
