"""Touchstone files of one port (.s1p), version 1, as network analysers write them.

References
----------
Touchstone File Format Specification, revision 1.1 (EIA/IBIS Open Forum, 2002): Z and Y are normalised to R.
"""

import numpy as np

from femfit.core.arrays import ComplexArray, FloatArray
from femfit.core.errors import TableError
from femfit.core.quoted import quoted
from femfit.tables.number_text import LARGEST
from femfit.tables.raw_table import RawTable, decode

_HERTZ = {"HZ": 1.0, "KHZ": 1e3, "MHZ": 1e6, "GHZ": 1e9}
_FORMATS = ("RI", "MA", "DB")


def parse_touchstone(content: bytes, source: str) -> RawTable:
    """Read a file of one port as frequency, resistance and reactance in series."""
    text, encoding = decode(content, source)
    hertz, kind, form, reference = 1e9, "S", "MA", 50.0
    options = False
    rows: list[tuple[int, list[float]]] = []
    for number, line in enumerate(text.splitlines(), 1):
        cells = line.partition("!")[0].upper().split()
        if cells and cells[0].startswith("["):
            raise TableError(f"{source} must be Touchstone of version 1; line {number} is of version 2. Save it so.")
        if cells and cells[0].startswith("#"):
            if not options:  # later option lines count for nothing
                hertz, kind, form, reference = _options(" ".join(cells)[1:], source, number)
            options = True
        elif cells:
            rows.append((number, _numbers(cells, source, number)))
    if not rows:
        raise TableError(f"{source} must have lines of a frequency and two numbers; it has none.")
    table = np.array([values for _, values in rows])
    with np.errstate(all="ignore"):  # the impedance of an open port, and of numbers that nobody measures
        z = _impedance(_complex(table[:, 1], table[:, 2], form), kind, reference)
        numbers = np.stack([hertz * table[:, 0], z.real, z.imag], axis=1)
        numbers = np.where(np.abs(numbers) < LARGEST, numbers, np.nan)
    return RawTable(
        source=source,
        headers=("frequency_Hz", "resistance_ohm", "reactance_ohm"),
        numbers=numbers,
        texts=[[f"{value:.12g}" if np.isfinite(value) else "" for value in column] for column in numbers.T],
        lines=[number for number, _ in rows],
        dialect=f"Touchstone, {encoding}, {kind} as {form}, {reference:g} ohm",
    )


def _options(text: str, source: str, number: int) -> tuple[float, str, str, float]:
    """Unit of the frequency, kind of parameter, format and reference resistance of a line of options."""
    hertz, kind, form, reference = 1e9, "S", "MA", 50.0
    cells = text.split()
    while cells:
        cell = cells.pop(0)
        if cell in _HERTZ:
            hertz = _HERTZ[cell]
        elif cell in {"S", "Y", "Z"}:
            kind = cell
        elif cell in _FORMATS:
            form = cell
        elif cell == "R" and cells:
            reference = _numbers([cells.pop(0), "0", "0"], source, number)[0]
        else:
            raise TableError(
                f"Line {number} of {source} must be like '# Hz S RI R 50', with S, Y or Z; instead received "
                f"{quoted(cell)}. Export S parameters."
            )
    if not reference > 0.0:
        raise TableError(f"The reference resistance of {source} must be > 0; instead received {reference:g} ohm.")
    return hertz, kind, form, reference


def _numbers(cells: list[str], source: str, number: int) -> list[float]:
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        values = []
    if len(values) != 3 or not np.isfinite(values).all():
        raise TableError(
            f"Line {number} of {source} must hold a frequency and two numbers, of one port; instead received "
            f"{quoted(' '.join(cells))}. Export the port that the coil is on alone, as .s1p."
        )
    return values


def _complex(a: FloatArray, b: FloatArray, form: str) -> ComplexArray:
    if form == "RI":
        return np.asarray(a + 1j * b)
    size = 10.0 ** (a / 20.0) if form == "DB" else a
    return np.asarray(size * np.exp(1j * np.radians(b)))


def _impedance(value: ComplexArray, kind: str, reference: float) -> ComplexArray:
    """In ohm; no finite number of an open port."""
    z = value if kind == "Z" else 1.0 / value if kind == "Y" else (1.0 + value) / (1.0 - value)
    return np.asarray(reference * z)
