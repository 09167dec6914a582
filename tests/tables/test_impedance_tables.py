"""Impedances as LCR meters and network analysers write them, read as resistance and inductance in series."""

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import TableError
from femfit.tables.circuit_columns import circuit_columns
from femfit.tables.measurement_file import read_measurement

FREQUENCY = np.geomspace(20.0, 20e3, 13)
OMEGA = 2.0 * np.pi * FREQUENCY
# A winding of 2 ohm and 5 mH, of which 0.3 lag with 1 ms
Z = 2.0 + 1j * OMEGA * 5e-3 * (1.0 - 0.3 * 1j * OMEGA * 1e-3 / (1.0 + 1j * OMEGA * 1e-3))
Y = 1.0 / Z
RESISTANCE, INDUCTANCE = Z.real, Z.imag / OMEGA
DEGREES = np.degrees(np.angle(Z))
LP, RP, QUALITY = -1.0 / (OMEGA * Y.imag), 1.0 / Y.real, Z.imag / Z.real

FORMS = {
    "series": {"Freq (Hz)": FREQUENCY, "Ls": INDUCTANCE, "Rs": RESISTANCE},
    "units": {"f/kHz": FREQUENCY / 1e3, "L_s / mH": 1e3 * INDUCTANCE, "R_s (Ω)": RESISTANCE},
    "magnitude": {"Frequency": FREQUENCY, "|Z|": np.abs(Z), "theta": DEGREES},
    "radians": {"freq_kHz": FREQUENCY / 1e3, "Z_abs": np.abs(Z), "phase [rad]": np.radians(DEGREES)},
    "parts": {"Frequency[Hz]": FREQUENCY, "Re(Z)": RESISTANCE, "Im(Z)": Z.imag},
    "primes": {"f [Hz]": FREQUENCY, "Z' / Ohm": RESISTANCE, "Z'' / kOhm": Z.imag / 1e3},
    "parallel": {"f (Hz)": FREQUENCY, "Lp (mH)": 1e3 * LP, "Rp (kOhm)": RP / 1e3},
    "quality": {"Freq": FREQUENCY, "Ls(H)": INDUCTANCE, "Q": QUALITY},
    "dissipation": {"Freq": FREQUENCY, "Lp": LP, "D": 1.0 / QUALITY},
    "angular": {"omega [rad/s]": OMEGA, "Ls": INDUCTANCE, "Rs": RESISTANCE, "Rdc [mOhm]": 2e3 + 0.0 * OMEGA},
}


def written(path, columns, **more):
    pd.DataFrame({"gap [mm]": 3.0, "DC Bias [mA]": 500.0, **columns}).to_csv(path, index=False, **more)
    return path


@pytest.mark.parametrize("form", [name for name in FORMS if name != "angular"])
def test_every_way_to_write_an_impedance_gives_the_same_series_equivalent(tmp_path, form):
    table = read_measurement(written(tmp_path / "z.csv", FORMS[form]))
    assert set(table.channels) == {"inductance_H", "resistance_ohm"}
    np.testing.assert_allclose(table.rows["frequency_Hz"], FREQUENCY, rtol=1e-12)
    np.testing.assert_allclose(table.rows["resistance_ohm"], RESISTANCE, rtol=1e-9)
    np.testing.assert_allclose(table.rows["inductance_H"], INDUCTANCE, rtol=1e-9)
    assert set(table.rows["distance_m"]) == {3e-3}
    assert set(table.rows["current_A"]) == {0.5}
    assert not table.rows["branch"].any()


def named(columns, circuit):
    """The headers with a circuit's name before the unit."""
    return {f"{header.rpartition('_')[0]}_{circuit}_{header.rpartition('_')[2]}": x for header, x in columns.items()}


@pytest.mark.parametrize(
    "columns",
    [
        {"resistance_ohm": RESISTANCE, "inductance_mH": 1e3 * INDUCTANCE},
        {"impedance_kohm": np.abs(Z) / 1e3, "phase_rad": np.radians(DEGREES)},
        {"resistance_ohm": RESISTANCE, "reactance_ohm": Z.imag},
        {"parallel_resistance_ohm": RP, "parallel_inductance_H": LP},
    ],
    ids="+".join,
)
def test_the_impedances_of_several_circuits_carry_their_names(tmp_path, columns):
    each = {"frequency_Hz": FREQUENCY, **named(columns, "lower"), **named(columns, "upper")}
    table = read_measurement(written(tmp_path / "z.csv", each))
    assert set(table.channels) == {*of_circuit("lower"), *of_circuit("upper")}
    for name in ("lower", "upper"):
        resistance, inductance = of_circuit(name)
        np.testing.assert_allclose(table.rows[resistance], RESISTANCE, rtol=1e-9)
        np.testing.assert_allclose(table.rows[inductance], INDUCTANCE, rtol=1e-9)


def of_circuit(name):
    return f"resistance_{name}_ohm", f"inductance_{name}_H"


def test_one_winding_of_several_may_be_read_alone_and_a_header_says_which(tmp_path):
    table = read_measurement(
        written(tmp_path / "z.csv", FORMS["series"]),
        columns={"Ls": "inductance_lower_H", "Rs": "resistance_lower_ohm"},
    )
    assert set(table.channels) == set(of_circuit("lower"))


def test_a_mutual_impedance_is_of_either_sign(tmp_path):
    """Windings against each other: the phase is beyond 90 degrees, as of no coil alone."""
    columns = {"current_lower_A": 0.0, "current_upper_A": 0.0, "f [Hz]": FREQUENCY}
    both = columns | {"impedance_lower_upper_ohm": np.abs(Z), "phase_lower_upper_deg": np.degrees(np.angle(-Z))}
    table = read_measurement(written(tmp_path / "z.csv", both))
    np.testing.assert_allclose(table.rows["inductance_lower_upper_H"], -INDUCTANCE, rtol=1e-9)
    assert not [one for one in table.findings if one.code == "resonance"]
    own = columns | {"resistance_lower_ohm": RESISTANCE, "inductance_lower_H": -INDUCTANCE}
    with pytest.raises(TableError, match="none in inductance_lower_H"):
        read_measurement(written(tmp_path / "z.csv", own))


def test_readings_that_differ_in_a_circuits_current_alone_are_no_copies(tmp_path):
    rows = {"current_lower_A": np.arange(8.0), "current_upper_A": 0.0, "flux_linkage_lower_Wb": 1e-3}
    table = read_measurement(written(tmp_path / "b.csv", rows | {"flux_linkage_upper_Wb": 2e-3, "run": 1}))
    assert len(table.rows) == 8


def test_a_known_name_is_no_circuit(tmp_path):
    columns = {"f [Hz]": FREQUENCY, "impedance_magnitude_ohm": np.abs(Z), "phase_angle_deg": DEGREES}
    table = read_measurement(written(tmp_path / "z.csv", columns))
    assert set(table.channels) == {"inductance_H", "resistance_ohm"}


def test_two_resistances_must_be_told_apart(tmp_path):
    path = written(tmp_path / "z.csv", FORMS["angular"])
    with pytest.raises(TableError, match="one column for resistance_ohm"):
        read_measurement(path)
    table = read_measurement(path, columns={"Rs": "resistance_ohm"})
    np.testing.assert_allclose(table.rows["resistance_ohm"], RESISTANCE, rtol=1e-9)


def test_a_resistance_at_direct_current_is_no_part_of_an_impedance(tmp_path):
    table = read_measurement(written(tmp_path / "z.csv", {"f [Hz]": FREQUENCY, "Ls": INDUCTANCE, "Rdc": 2.0}))
    assert table.channels == ("inductance_H",)
    assert any("direct current" in str(one) for one in table.findings)


def test_a_german_export_with_decimal_commas_is_read(tmp_path):
    columns = {"Frequenz [kHz]": FREQUENCY / 1e3, "Betrag [Ohm]": np.abs(Z), "Phasenwinkel [Grad]": DEGREES}
    frame = pd.DataFrame({"Luftspalt [mm]": 2.5, "Vorstrom [mA]": 250.0, **columns})
    frame.to_csv(tmp_path / "z.csv", index=False, sep=";", decimal=",", encoding="cp1252")
    table = read_measurement(tmp_path / "z.csv")
    np.testing.assert_allclose(table.rows["inductance_H"], INDUCTANCE, rtol=1e-9)
    assert set(table.rows["current_A"]) == {0.25}


def test_what_was_the_same_throughout_can_be_said(tmp_path):
    path = tmp_path / "z.csv"
    pd.DataFrame(FORMS["magnitude"]).to_csv(path, index=False)
    with pytest.raises(TableError, match="--setting distance_mm"):
        read_measurement(path)
    table = read_measurement(path, settings={"distance_mm": 2.0})
    assert set(table.rows["distance_m"]) == {2e-3}
    assert set(table.rows["current_A"]) == {0.0}
    assert any("taken for 0 A" in str(one) for one in table.findings)
    assert {"distance_m", "current_A", "frequency_Hz"} <= set(table.given)
    path.with_suffix(".toml").write_text(
        "[settings]\ndistance_mm = 4.0\ncurrent_mA = 300\n[noise]\nimpedance_percent = 0.2"
    )
    said = read_measurement(path)
    assert set(said.rows["distance_m"]) == {4e-3}
    assert set(said.rows["current_A"]) == {0.3}
    assert said.declared_noise == {"impedance_share": pytest.approx(0.002)}
    assert set(read_measurement(path, settings={"distance_um": 900}).rows["distance_m"]) == {9e-4}


def test_a_meter_of_one_frequency_is_read_with_that_frequency(tmp_path):
    pd.DataFrame({"gap [mm]": [1.0, 2.0], "Ls [mH]": [5.0, 4.0], "Q": [10.0, 9.0]}).to_csv(tmp_path / "l.csv")
    table = read_measurement(tmp_path / "l.csv", settings={"frequency_kHz": 1.0})
    np.testing.assert_allclose(table.rows["resistance_ohm"], 2e3 * np.pi * np.array([5e-4, 4e-3 / 9.0]))


@pytest.mark.parametrize("said", [{"distance_mm": "2"}, {"gap": 2.0}, {"distance_mm": float("nan")}])
def test_a_setting_that_is_none_is_refused(tmp_path, said):
    with pytest.raises(TableError, match="must be like distance_mm"):
        read_measurement(written(tmp_path / "z.csv", FORMS["series"]), settings=said)


def test_a_setting_beside_its_column_is_refused(tmp_path):
    with pytest.raises(TableError, match="no constant setting"):
        read_measurement(written(tmp_path / "z.csv", FORMS["series"]), settings={"distance_mm": 2.0})


BAD = {
    "frequency > 0": {"f [Hz]": np.append(0.0, FREQUENCY[1:]), "Ls": INDUCTANCE, "Rs": RESISTANCE},
    "phase of -90 to 90": {"f [Hz]": FREQUENCY, "|Z|": np.abs(Z), "theta": DEGREES + 40.0},
    "magnitude >= 0": {"f [Hz]": FREQUENCY, "|Z|": -np.abs(Z), "theta": DEGREES},
    "Add phase_deg": {"f [Hz]": FREQUENCY, "|Z|": np.abs(Z)},
    "other way round": {"f [Hz]": FREQUENCY, "|Z|": np.abs(Z), "theta": -DEGREES},
}


@pytest.mark.parametrize("said", BAD)
def test_what_no_coil_has_is_refused_with_a_remedy(tmp_path, said):
    with pytest.raises(TableError, match=said):
        read_measurement(written(tmp_path / "z.csv", BAD[said]))


def test_a_phase_that_counts_the_other_way_round_is_read_with_its_sign(tmp_path):
    path = written(tmp_path / "z.csv", {"f [Hz]": FREQUENCY, "|Z|": np.abs(Z), "theta": -DEGREES})
    table = read_measurement(path, units={"theta": -1.0})
    np.testing.assert_allclose(table.rows["inductance_H"], INDUCTANCE, rtol=1e-9)


def test_a_phase_in_radians_without_a_unit_is_suspected(tmp_path):
    path = written(tmp_path / "z.csv", {"f [Hz]": FREQUENCY, "|Z|": np.abs(Z), "theta": np.radians(DEGREES)})
    suspected = [one for one in read_measurement(path).findings if one.code == "suspected-unit"]
    assert [one.column for one in suspected] == ["phase_deg"]
    table = read_measurement(path, units={"theta": "rad"})
    np.testing.assert_allclose(table.rows["resistance_ohm"], RESISTANCE, rtol=1e-9)
    assert not [one for one in table.findings if one.code == "suspected-unit"]


def test_readings_above_the_winding_s_resonance_are_set_aside(tmp_path):
    parallel = 1.0 / (Y + 1j * OMEGA / (5e-3 * (2.0 * np.pi * 12e3) ** 2))  # a capacitance that resonates at 12 kHz
    table = read_measurement(
        written(tmp_path / "z.csv", {"f [Hz]": FREQUENCY, "R": 0, "Re(Z)": parallel.real, "Im(Z)": parallel.imag})
    )
    capacitive = parallel.imag < 0.0
    assert capacitive.any()
    assert (table.rows["inductance_H"].isna() == capacitive).all()
    assert any(one.code == "resonance" for one in table.findings)


@pytest.mark.parametrize("form", ["series", "polar"])
def test_a_mutual_impedance_by_itself_is_of_either_sign(tmp_path, form):
    columns = {
        "series": {"inductance_lower_upper_H": -INDUCTANCE, "resistance_lower_upper_ohm": RESISTANCE},
        "polar": {"impedance_lower_upper_ohm": np.abs(Z), "phase_lower_upper_deg": DEGREES - 180.0},
    }[form]
    table = read_measurement(written(tmp_path / "z.csv", {"frequency_Hz": FREQUENCY} | columns))
    np.testing.assert_allclose(table.rows["inductance_lower_upper_H"], -INDUCTANCE, rtol=1e-9)
    assert not any(one.code == "resonance" for one in table.findings)


def test_a_quality_without_a_name_is_that_of_the_only_impedance(tmp_path):
    path = written(tmp_path / "z.csv", {"f [Hz]": FREQUENCY, "Ls": INDUCTANCE, "Q": OMEGA * INDUCTANCE / RESISTANCE})
    table = read_measurement(path, columns={"Ls": "inductance_lower_H"})
    np.testing.assert_allclose(table.rows["resistance_lower_ohm"], RESISTANCE, rtol=1e-9)
    columns = {"inductance_lower_H": INDUCTANCE, "inductance_upper_H": INDUCTANCE, "Q": 2.0}
    with pytest.raises(TableError, match="two numbers"):
        read_measurement(written(tmp_path / "z.csv", {"f [Hz]": FREQUENCY} | columns))


@pytest.mark.parametrize("name", ["coil-1", "Coil", "upper_Coil"])
def test_a_circuit_s_name_may_have_hyphens_and_capitals(tmp_path, name):
    columns = {f"inductance_{name}_uH": 1e6 * INDUCTANCE, f"resistance_{name}_ohm": RESISTANCE}
    table = read_measurement(written(tmp_path / "z.csv", {"f [Hz]": FREQUENCY} | columns))
    np.testing.assert_allclose(table.rows[f"inductance_{name}_H"], INDUCTANCE, rtol=1e-9)


@pytest.mark.parametrize("units", [("[uH]", "[ohm]"), (" (µH)", " (Ω)")], ids=["square", "round"])
def test_the_unit_behind_a_circuit_s_name_may_stand_in_brackets(tmp_path, units):
    columns = {"current_lower [A]": 0.1, "current_upper [mA]": 200.0, "frequency [kHz]": 1e-3 * FREQUENCY}
    for name, scale in (("lower", 1.0), ("upper", 2.0)):
        columns[f"inductance_{name} {units[0]}"] = scale * 1e6 * INDUCTANCE
        columns[f"resistance_{name} {units[1]}"] = scale * RESISTANCE
    path = tmp_path / "z.csv"
    pd.DataFrame({"distance [mm]": 3.0, **columns}).to_csv(path, index=False)
    table = read_measurement(path)
    np.testing.assert_allclose(table.rows["inductance_upper_H"], 2.0 * INDUCTANCE, rtol=1e-9)
    np.testing.assert_allclose(table.rows["resistance_lower_ohm"], RESISTANCE, rtol=1e-9)
    assert set(table.rows["current_upper_A"]) == {0.2}
    assert not any(one.code == "unused-column" for one in table.findings)


def test_brackets_name_no_circuits_without_an_impedance():
    assert circuit_columns(["time [s]", "current_coil [A]", "voltage_supply [V]"]) == ()
    assert circuit_columns(["impedance_coil [ohm]", "phase_coil [°]"]) == ("impedance_coil_ohm", "phase_coil_deg")
