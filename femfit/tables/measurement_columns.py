"""From the headers of a measured file to the contract's columns, in SI units.

A header is the contract's name (``distance_m``), or its stem or another name for it with any unit of its kind
(``distance_mm``, ``Distance [mm]``, ``Luftspalt in mm``).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

from femfit.core.errors import TableError
from femfit.tables.header import parse_header
from femfit.tables.measurement import CHANNELS, SETTINGS
from femfit.tables.measurement_names import MEASUREMENT_NAMES
from femfit.tables.units import unit_factor

_UNIT = {"m": "m", "A": "A", "C": "degC", "N": "N", "Wb": "Wb", "H": "H", "V": "V", "s": "s"}

BENCH_COLUMNS = (*SETTINGS, *CHANNELS)
"""Of a bench table."""


@dataclass(frozen=True)
class UsedColumn:
    """How a column of a file becomes one of the contract's.

    Parameters
    ----------
    factor : float
        Number in the file times this is SI.
    """

    header: str
    name: str
    factor: float


def stem_and_unit(name: str) -> tuple[str, str]:
    """The quantity in a contract column's name, and its SI unit; no unit for ``run, mount, order, branch``.

    Returns
    -------
    tuple of str
        For ``flux_linkage_Wb``: ``flux_linkage`` and ``Wb``.
    """
    stem, _, unit = name.rpartition("_")
    return (stem, _UNIT[unit]) if stem else (name, "")


def recognise(
    headers: Iterable[str], source: str, names: Sequence[str] = BENCH_COLUMNS
) -> tuple[list[UsedColumn], list[str]]:
    """Find the contract's columns among headers.

    Returns
    -------
    tuple of list of UsedColumn and list of str
        What is used, and one sentence for each column that is not or whose unit was converted.

    Raises
    ------
    TableError
        If two headers mean the same column.
    """
    used: list[UsedColumn] = []
    findings: list[str] = []
    for header in headers:
        column, finding = match_column(header, names)
        if finding:
            findings.append(finding)
        if column is None:
            continue
        twin = next((one.header for one in used if one.name == column.name), None)
        if twin is not None:
            raise TableError(
                f"{source} must have one column for {column.name}; instead received {twin!r} and {header!r}. "
                "Remove one."
            )
        used.append(column)
    return used, findings


def match_column(header: str, names: Sequence[str] = BENCH_COLUMNS) -> tuple[UsedColumn | None, str]:
    """The contract's column that a header means.

    Parameters
    ----------
    header : str
        As it stands in a file.

    Returns
    -------
    tuple of UsedColumn or None, and str
        None where it means none; a sentence where there is something to say.
    """
    if header.strip() in names:
        return UsedColumn(header, header.strip(), 1.0), ""
    parsed = parse_header(header)
    words = "".join(parsed.words)
    for name in names:
        stem, unit = stem_and_unit(name)
        if words != stem.replace("_", "") and words not in MEASUREMENT_NAMES.get(name, ()):
            continue
        if len(words) == 1 and (parsed.unit is None or unit_factor(parsed.unit, unit) is None):
            continue
        if parsed.unit is None:
            assumed = f"Column {header!r} was read as {name}." if header != name else ""
            return UsedColumn(header, name, 1.0), assumed
        factor = unit_factor(parsed.unit, unit) if unit else None
        if factor is None:
            return None, f"Column {header!r} is in {parsed.unit}, where {name} is needed; it was not used."
        how = f"read as {name}" if factor == 1.0 else f"converted to {name}, times {factor:g}"
        return UsedColumn(header, name, factor), f"Column {header!r} was {how}."
    near = get_close_matches(header.strip(), names, n=1, cutoff=0.75)
    meant = f"; did you mean {near[0]}?" if near else "."
    return None, f"Column {header!r} is none that such a file has and was not used{meant}"
