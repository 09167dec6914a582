"""Exact decimals: what the file writes in mm is the nearest double in m, and 0.2 * 3 is 0.6."""

from decimal import Decimal


def scaled(value: float, exponent: int = -3) -> float:
    """The double nearest to value * 10^exponent, as from mm to m, the value taken with the digits that print it."""
    return float(Decimal(repr(float(value))).scaleb(exponent))


def decimal_sum(offset: float, factor: float, value: float) -> float:
    """The double nearest to offset + factor * value, all three taken with the digits that print them."""
    first, second, third = (Decimal(repr(float(number))) for number in (offset, factor, value))
    return float(first + second * third)
