"""Formulas of the law catalogue with their exponents raised."""

import re

from markupsafe import Markup, escape

_EXPONENT = re.compile(r"\^(?:\((-?[\d/]+)\)|(-?\d+))")


def formula_markup(formula: str) -> Markup:
    """A formula for the page.

    Parameters
    ----------
    formula : str
        In plain text, exponents as ``^-4`` or ``^(-3/2)``.
    """
    raised = _EXPONENT.sub(lambda m: f"<sup>{_minus(m)}</sup>", str(escape(formula)))
    return Markup(raised)  # noqa: S704 - escaped before


def formula_label(formula: str) -> str:
    """A formula for a picture's label."""
    return _EXPONENT.sub(lambda m: f"$^{{{_minus(m)}}}$", formula)


def _minus(match: re.Match[str]) -> str:
    return (match[1] or match[2]).replace("-", "−")
