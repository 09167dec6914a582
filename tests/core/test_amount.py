"""Quantities are said with one prefix rule everywhere."""

import numpy as np
import pytest

from femfit.core.text import amount, amount_in, amount_range, counted, probability, rounded


@pytest.mark.parametrize(
    ("value", "unit", "said"),
    [(2e-4, "m", "0.20 mm"), (38.2, "K", "38 K"), (0.0082, "N", "8.2 mN"), (0.4, "A", "0.40 A"), (0.0404, "", "4.0 %"),
     (-3e-3, "1/K", "-0.30 % per K"), (3e-6, "m", "3.0 µm"), (0.0, "V", "0 V"), (0.00996, "T", "10 mT")],
)  # fmt: skip
def test_amounts_have_a_prefix_and_two_digits(value, unit, said):
    assert amount(value, unit) == said


@pytest.mark.parametrize(
    ("value", "column", "said"),
    [(0.018, "distance_m", "18.0 mm"), (1.25, "mount_m", "1.25 m"), (9.4e-4, "mass_kg", "940 mg"),
     (1.2, "kg", "1.20 kg"), (27.0, "coil_temperature_C", "27 °C"), (2e-17, "force_N", "2.00e-17 N"),
     (float("nan"), "N", "unknown"), (0.99996, "N", "1.00 N"), (5e5, "N", "500 kN"), (3e-8, "T/A", "30.0 nT/A")],
)  # fmt: skip
def test_a_column_is_said_in_the_unit_that_its_name_ends_in(value, column, said):
    assert amount(value, column, 3) == said


@pytest.mark.parametrize(
    ("low", "high", "unit", "said"),
    [(0.0248, 0.0252, "", "2.48 to 2.52 %"), (98e-6, 104e-6, "m", "0.098 to 0.104 mm"),
     (0.0, 0.0131, "N", "0 to 13 mN"), (-3e-6, 1.2e-4, "mount_m", "-0.003 to 0.120 mm"),
     (20.1, 20.4, "coil_temperature_C", "20.1 to 20.4 °C"),
     (2.5, 2.5, "A", "2.5 A"), (-0.05, -0.048, "1/K", "-5.0 to -4.8 % per K"),
     (-1.0, float("inf"), "N", "-1.0 N to unknown")],
)  # fmt: skip
def test_an_interval_has_one_unit_and_the_digits_that_tell_its_ends_apart(low, high, unit, said):
    assert amount_range(low, high, unit) == said


@pytest.mark.parametrize("unit", ["m", "", "kg", "coil_temperature_C", "N"])
def test_a_value_is_written_within_its_interval(unit):
    rng = np.random.default_rng(1)
    lows, parts = rng.normal(size=200) * 10.0 ** rng.integers(-1, 3, 200), rng.random((2, 200))
    for low, width, share in zip(lows, *parts, strict=True):
        high = low + abs(low) * 10.0 ** (-5.0 * width)
        value, unit_of_value = amount_in(low + share * (high - low), low, high, unit).split(" ", 1)
        ends, unit_of_ends = amount_range(low, high, unit).rsplit(" ", 1)
        first, _, last = ends.partition(" to ")
        assert float(first) <= float(value) <= float(last or first)
        assert unit_of_value == unit_of_ends


def test_counts_powers_of_ten_and_probabilities_are_said_in_words_of_their_size():
    assert rounded(1.234e-7, 2) == "1.2e-07"
    assert probability(1e-9) == "p < 1e-06"
    assert probability(0.0312) == "p = 0.031"
    said = [counted(n, "row was", "rows were") for n in (0, 1, 2)]
    assert said == ["0 rows were", "1 row was", "2 rows were"]
    assert counted(1200, "point") == "1,200 points"
