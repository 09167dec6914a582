"""Numbers as text keep their value."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from femfit.core.text import axis_scale
from femfit.report.style import (
    formula_markup,
    percent,
    quantity,
    significant,
)

PREFIX = {"p": 1e-12, "n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3, "M": 1e6}
POWER = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def number(written):
    """What a reader reads."""
    mantissa, _, power = written.replace("−", "-").partition("·10")
    return float(mantissa) * 10.0 ** float(power.translate(POWER) or 0)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.0427, "42.7 mN"),
        (0.99996, "1.00 N"),  # rounding carries into the next prefix
        (-597e-6, "−597 µN"),
        (0.0, "0 N"),
        (29.8, "29.8 N"),
        (6.61e-4, "661 µN"),
        (None, "unknown"),
        (float("nan"), "unknown"),
    ],
)
def test_quantities_carry_an_si_prefix(value, expected):
    assert quantity(value, "N").replace("\u00a0", " ") == expected


@given(st.floats(1e-12, 1e8), st.integers(2, 6), st.sampled_from([1.0, -1.0]))
def test_a_quantity_read_again_is_the_value_to_its_digits(magnitude, digits, sign):
    written, unit = quantity(sign * magnitude, "T", digits).split("\u00a0")
    assert number(written) * PREFIX[unit.removesuffix("T")] == pytest.approx(
        sign * magnitude, rel=0.51 * 10 ** (1 - digits)
    )


@given(st.floats(1e-30, 1e30), st.integers(2, 6))
def test_significant_digits_are_as_many_as_asked_for(value, digits):
    written = significant(value, digits)
    assert number(written) == pytest.approx(value, rel=0.51 * 10 ** (1 - digits))
    mantissa = written.partition("·")[0]
    if "." in mantissa:
        assert len(re.sub(r"^0*", "", mantissa.replace(".", ""))) == digits


def test_fractions_axes_and_exponents_are_written_as_a_reader_expects():
    assert percent(0.0036).replace("\u00a0", " ") == "0.36 %"
    assert percent(1.03, 3).replace("\u00a0", " ") == "103 %"
    assert percent(float("inf")) == "unknown"
    assert axis_scale([0.24, -0.1], "N") == (1e3, "mN")
    assert axis_scale([29.8, float("nan")], "force_N") == (1.0, "N")
    assert formula_markup("a d^-4 + b (d^2 + R^2)^(-3/2)") == (
        "a d<sup>−4</sup> + b (d<sup>2</sup> + R<sup>2</sup>)<sup>−3/2</sup>"
    )
