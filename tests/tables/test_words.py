"""What a user says of a coil's record, in a sidecar or a call, holds for every reader; what cannot be is refused."""

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import TableError
from femfit.integrate.bench_table import make_bench_table
from femfit.integrate.integrate_coil import integrate_coil
from femfit.tables.coil_record import open_coil_record
from femfit.tables.measurement_file import read_measurement

TIME = np.arange(0.0, 2.0, 1e-3)
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
