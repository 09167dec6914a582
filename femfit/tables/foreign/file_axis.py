"""A current or distance that stands in a file's name: ``force_1.4A.csv``, ``I=0,6.txt``, ``gap_20mm_i0p4A.dat``."""

import re
from pathlib import Path

from femfit.tables.column_names import COLUMN_NAMES, STEP_NAMES
from femfit.tables.foreign.options import QUANTITIES, si_unit
from femfit.tables.units import unit_factor

_NUMBER = r"(?P<number>(?:(?<![A-Za-z0-9])[-+])?\d+(?:[.,p]\d+)?(?:e-?\d+)?)"
_UNITS = {"current": r"(?P<unit>[mu]?A|amps?)", "distance": r"(?P<unit>[mcu]?m|in(?:ch)?)"}


def value_in_name(path: Path, quantity: str) -> float | None:
    """Read a current (A) or distance (m) from a file's name; ``p`` may stand for the decimal point.

    A hyphen is a minus only where no letter or digit precedes it. None unless the name holds exactly one such number,
    with its unit or after the quantity's name.
    """
    known = (*COLUMN_NAMES[QUANTITIES[quantity]], *(STEP_NAMES if quantity == "distance" else ()))
    with_unit = [
        (match.group("number"), match.group("unit"))
        for match in re.finditer(rf"(?<![\d.,]){_NUMBER}[ _]?{_UNITS[quantity]}(?![A-Za-z0-9])", path.stem)
    ]
    names = "|".join(sorted((name for name in known if name.isascii()), key=len, reverse=True))
    named = [
        (match.group("number"), si_unit(quantity))
        for match in re.finditer(rf"(?i:(?<![A-Za-z])(?:{names}))[ _=\-]*{_NUMBER}(?![A-Za-z0-9])", path.stem)
    ]
    bare = re.fullmatch(_NUMBER, path.stem) if quantity == "current" else None
    found = with_unit or named or ([(bare.group("number"), "A")] if bare else [])
    if len(found) != 1:
        return None
    number, unit = found[0]
    factor = unit_factor(unit, si_unit(quantity))
    return None if factor is None else float(number.replace(",", ".").replace("p", ".")) * factor
