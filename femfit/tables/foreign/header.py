"""How surely a column's header names a quantity."""

from femfit.tables.foreign.quantities import FOREIGN_WORDS, QUANTITIES
from femfit.tables.header import Header
from femfit.tables.units import unit_factor


def match_score(header: Header, quantity: str) -> int:
    """How surely a header names a quantity.

    Parameters
    ----------
    header : Header
        From :func:`femfit.tables.header.parse_header`.
    quantity : str
        A key of :data:`femfit.tables.foreign.quantities.QUANTITIES`.

    Returns
    -------
    int
        0 no; 1 contains the name inside a word; 2 contains it as words; 3 is the name; one half better
        (doubled scale) if its unit fits. A unit of another kind makes it 0.
    """
    entry = QUANTITIES[quantity]
    unit_fits = header.unit is not None and unit_factor(header.unit, entry.si_unit) is not None
    if header.unit is not None and header.unit_known and not unit_fits:
        return 0
    score = _name_score(header.words, entry.names)
    return 2 * score + unit_fits if score else 0


def _name_score(words: tuple[str, ...], names: tuple[str, ...]) -> int:
    compact = "".join(words)
    if compact in names:
        return 3
    if FOREIGN_WORDS.intersection(words) or not words:
        return 0
    if words[0] in names and len(words) == 2:
        return 2
    phrases = {"".join(words[a:b]) for a in range(len(words)) for b in range(a + 1, len(words) + 1)}
    if any(name in phrases for name in names if len(name) > 1):
        return 2
    return int(any(name in compact for name in names if len(name) >= 5))
