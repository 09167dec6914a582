"""Every way to write an impedance gives the same resistance and inductance in series."""

import numpy as np
import pandas as pd
import pytest

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
}
OF_CIRCUITS = {
    "impedance": {"impedance_{}_kohm": np.abs(Z) / 1e3, "phase_{}_rad": np.radians(DEGREES)},
    "reactance": {"resistance_{}_ohm": RESISTANCE, "reactance_{}_ohm": Z.imag},
    "parallel circuit": {"parallel_resistance_{}_ohm": RP, "parallel_inductance_{}_H": LP},
}


def read(path, columns):
    pd.DataFrame({"gap [mm]": 3.0, "DC Bias [mA]": 500.0, **columns}).to_csv(path / "z.csv", index=False)
    return read_measurement(path / "z.csv")


@pytest.mark.parametrize("form", FORMS)
def test_every_way_to_write_an_impedance_gives_the_same_series_equivalent(tmp_path, form):
    table = read(tmp_path, FORMS[form])
    assert set(table.channels) == {"inductance_H", "resistance_ohm"}
    np.testing.assert_allclose(table.rows["frequency_Hz"], FREQUENCY, rtol=1e-12)
    np.testing.assert_allclose(table.rows["resistance_ohm"], RESISTANCE, rtol=1e-9)
    np.testing.assert_allclose(table.rows["inductance_H"], INDUCTANCE, rtol=1e-9)
    assert (set(table.rows["distance_m"]), set(table.rows["current_A"])) == ({3e-3}, {0.5})
    assert not table.rows["branch"].any()


@pytest.mark.parametrize("form", OF_CIRCUITS)
def test_so_does_every_way_to_write_those_of_several_circuits(tmp_path, form):
    names = ("lower", "upper")
    columns = {key.format(name): x for name in names for key, x in OF_CIRCUITS[form].items()}
    table = read(tmp_path, {"frequency_Hz": FREQUENCY} | columns)
    assert set(table.channels) == {f"{key}_{name}_{unit}" for name in names
                                   for key, unit in (("resistance", "ohm"), ("inductance", "H"))}  # fmt: skip
    for name in names:
        np.testing.assert_allclose(table.rows[f"resistance_{name}_ohm"], RESISTANCE, rtol=1e-9)
        np.testing.assert_allclose(table.rows[f"inductance_{name}_H"], INDUCTANCE, rtol=1e-9)


def test_readings_above_the_winding_s_resonance_are_set_aside(tmp_path):
    parallel = 1.0 / (Y + 1j * OMEGA / (5e-3 * (2.0 * np.pi * 12e3) ** 2))  # a capacitance that resonates at 12 kHz
    table = read(tmp_path, {"f [Hz]": FREQUENCY, "R": 0, "Re(Z)": parallel.real, "Im(Z)": parallel.imag})
    capacitive = parallel.imag < 0.0
    assert capacitive.any()
    assert (table.rows["inductance_H"].isna() == capacitive).all()
    assert "resonance" in {one.code for one in table.findings}
