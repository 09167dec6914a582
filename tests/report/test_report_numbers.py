"""Numbers as text keep their value."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from femfit.report.style import quantity

PREFIX = {"p": 1e-12, "n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3, "M": 1e6}
POWER = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def number(written):
    """What a reader reads."""
    mantissa, _, power = written.replace("−", "-").partition("·10")
    return float(mantissa) * 10.0 ** float(power.translate(POWER) or 0)


@given(st.floats(1e-12, 1e8), st.integers(2, 6), st.sampled_from([1.0, -1.0]))
def test_a_quantity_read_again_is_the_value_to_its_digits(magnitude, digits, sign):
    written, unit = quantity(sign * magnitude, "T", digits).split("\u00a0")
    assert number(written) * PREFIX[unit.removesuffix("T")] == pytest.approx(
        sign * magnitude, rel=0.51 * 10 ** (1 - digits)
    )
