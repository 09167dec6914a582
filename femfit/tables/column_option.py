"""How a user says on the command line what a column is, ready to be pasted."""

import shlex
from collections.abc import Sequence

from femfit.core.results import listing
from femfit.core.text import quoted
from femfit.tables.header import match_score, names_of, parse_header
from femfit.tables.units import column_unit, unit_factor

_READ_BY_SHELLS = frozenset('"$`\\!%')
"""Characters that a shell acts on within double quotes, which all shells know."""


def column_option(header: str, name: str) -> str:
    """The option that says what a column is, quoted for a shell where it must be.

    Examples
    --------
    >>> print(column_option("CH1 voltage (V)", "voltage_V"), column_option("Kraft", "force_N"))
    --column "CH1 voltage (V)=voltage_V" --column Kraft=force_N
    """
    fit = quoted(header.strip()) == header.strip()  # neither long nor with control characters
    text = f"{header.strip() if fit else 'HEADER'}={name}"
    if shlex.quote(text) == text:
        return f"--column {text}"
    return f"--column {shlex.quote(text)}" if _READ_BY_SHELLS.intersection(text) else f'--column "{text}"'


def remedy_for_columns(unused: Sequence[str], needed: Sequence[str]) -> str:
    """What to do where columns are missing: which of the unused ones each may be, by its words or its unit.

    Parameters
    ----------
    needed : sequence of str
        Columns that are missing, or of which one is, the most wanted first.
    """
    if not unused:
        return f"Add {needed[0]}."
    likely = likely_columns(unused, needed, by_words=False)
    options = [column_option(header, likely[header]) for header in unused if header in likely]
    options = options or [column_option(unused[0], needed[0])]
    return (
        f"Not used: {listing(unused, 20)}. Rename columns, or say what they are, for example with {' '.join(options)}."
    )


def likely_columns(headers: Sequence[str], names: Sequence[str], *, by_words: bool = True) -> dict[str, str]:
    """What headers may mean, each column once; without words whatever their units allow comes after."""
    result: dict[str, str] = {}
    for only_words in (True, by_words):
        for name in names:
            free = [header for header in headers if header not in result]
            meant = next((header for header in free if _may_be(header, name, by_words=only_words)), None)
            if meant is not None and name not in result.values():
                result[meant] = name
    return result


def _may_be(header: str, name: str, *, by_words: bool) -> bool:
    parsed, (stem, si_unit) = parse_header(header), column_unit(name)
    fits = bool(si_unit) and parsed.unit is not None and unit_factor(parsed.unit, si_unit) is not None
    words = fits and bool({stem, *names_of(name)}.intersection(parsed.words))
    return (match_score(parsed, name, guess=True) > 0 or words) if by_words else fits
