"""From the headers of any table to columns in SI units.

A header is the column's name (``distance_m``), or its stem or another name for it with any unit of its kind
(``distance_mm``, ``Distance [mm]``, ``Luftspalt in mm``), or what the caller says it is.
"""

import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pandas as pd

from femfit.core.numerics import GRAVITY, LARGEST, FloatArray
from femfit.core.results import Finding, listing
from femfit.core.text import quoted
from femfit.tables.findings import finding, refused
from femfit.tables.header import Likeness, find_header, matching_headers, parse_header, score
from femfit.tables.measurement import CHANNELS, SETTINGS
from femfit.tables.raw_table import EMPTY, RawTable, clock_seconds, looks_numeric
from femfit.tables.units import CHANNELS as REGISTRY
from femfit.tables.units import column_unit, given_factor, unit_factor

BENCH_COLUMNS = (*SETTINGS, *CHANNELS)
"""Of a bench table."""

_BRANCH_WORDS = {
    **dict.fromkeys(("rising", "rise", "up", "+", "increasing", "ascending", "steigend", "auf", "hin"), 1.0),
    **dict.fromkeys(("falling", "fall", "down", "-", "decreasing", "descending", "fallend", "ab", "zurück"), -1.0),
}
_SIMULATED = ("true_", "estimated_")
"""How columns begin that a simulation writes beside its readings; nobody measured them."""


@dataclass(frozen=True)
class UsedColumn:
    """How a column of a file (or what stands for one) becomes one of ours: its number times ``factor`` is SI."""

    data = "quantity", "column=name", "header", "unit", "factor_to_SI=factor", "unit_assumed=assumed"

    header: str
    name: str
    factor: float
    unit: str
    assumed: bool = False  # True if neither the file nor the user named a unit

    @property
    def quantity(self) -> str:
        """The column's name without its unit."""
        return column_unit(self.name)[0]

    def conversion(self) -> Finding:
        """Say as what a column of another header is read."""
        how = f"read as {self.name}" if self.factor == 1.0 else f"converted to {self.name}, times {self.factor:g}"
        in_grams = self.name == "force_N" and self.factor == GRAVITY * 1e-3
        how += f" ({self.unit} as a weight, gram-force)" if in_grams else ""
        return finding("column", column=self.name, header=quoted(self.header), how=how)


def match_columns(
    headers: Sequence[str],
    source: str,
    names: Sequence[str],
    columns: Mapping[str, str],
    units: Mapping[str, str | float],
    optional: Collection[str] = (),
    guessed: Sequence[str] = (),
) -> tuple[list[UsedColumn], list[Finding]]:
    """Find columns among headers, in the file's order, and say what was left to the user, and what is not used.

    The user's ``columns`` say which header is which column where its name does not say it, and ``units``, by header or
    column, its unit or a number that multiplies it to SI. An optional column is left out, not refused, where several
    headers may be it. What is still missing of the guessed columns is a header with a word of its name in its unit.
    """
    wanted = {find_header(key, headers, source, "--column"): name for key, name in columns.items()}
    for header, name in wanted.items():
        if name not in names:
            facts = {"header": quoted(header), "column_name": quoted(name), "columns": ", ".join(names)}
            raise refused("unwanted-column", source=source, **facts)
    chosen = {name: headers.index(header) for header, name in wanted.items()}
    texts: dict[str, str] = {}
    for key, unit in units.items():
        texts |= dict.fromkeys(matching_headers(key, headers) or [key], str(unit))
    scores = {name: [_score(header, name, texts.get(header, texts.get(name))) for header in headers] for name in names}
    best = [max(of_header) for of_header in zip(*scores.values(), strict=True)]
    for name, enough in [*product(names, [Likeness.MAYBE]), *product(guessed, [Likeness.WORD_IN_UNIT])]:
        # A column belongs to the quantity that it names best: "flux density" is no flux linkage.
        free = {k: how for k, how in enumerate(scores[name]) if enough <= how == best[k] and k not in chosen.values()}
        top = [k for k, how in free.items() if how == max(free.values())]
        if name in chosen or not top or (name in optional and len(top) > 1):
            continue
        if len(top) > 1 and free[top[0]] == Likeness.SURE:
            raise refused("several-columns", source=source, name=name, headers=listing(headers[k] for k in top))
        chosen[name] = top[0]
    used = [
        used_column(headers[k], name, source, texts.get(name, texts.get(headers[k], "")))
        for name, k in sorted(chosen.items(), key=lambda choice: choice[1])
    ]
    for key in (key for key in texts if key not in chosen):
        find_header(key, headers, source, "--unit")
    unused = [header for k, header in enumerate(headers) if header.strip() and k not in chosen.values()]
    if not unused:
        return used, []
    measured = [header for header in unused if not header.startswith(_SIMULATED)]
    options = " ".join(column_options(measured, [name for name in names if name not in chosen], Likeness.WORD))
    remedy = f"Where one is meant, say {options}." if options else ""
    return used, [finding("unused-column", headers=listing(unused, 20), options=remedy)]


def match_column(header: str, names: Sequence[str]) -> UsedColumn | None:
    """Return the column that a header means, if its unit is one of the right kind."""
    name = next((name for name in names if score(parse_header(header), name) >= Likeness.MAYBE), None)
    return None if name is None else used_column(header, name)


def used_column(header: str, name: str, source: str = "", unit: str = "") -> UsedColumn:
    """Return the use of a column in the unit that the user gives, or else the file."""
    _, si_unit = column_unit(name)
    plain = header.strip() == name
    unit = unit or ("" if plain or not si_unit else parse_header(header).unit or "")
    if not unit:
        return UsedColumn(header, name, 1.0, si_unit, assumed=bool(si_unit) and not plain)
    return UsedColumn(header, name, given_factor(unit, si_unit, header, source, name), unit)


def _score(header: str, name: str, override: str | None) -> int:
    """How surely a header names a column; the unit that the user says counts in place of one of another kind."""
    if header.strip() == name:
        return Likeness.SURE
    parsed, (_, si_unit) = parse_header(header), column_unit(name)
    if override is not None and unit_factor(override, si_unit) is not None:
        parsed = replace(parsed, unit=override)
    elif override is not None and unit_factor(parsed.unit or "", si_unit) is None:
        parsed = replace(parsed, unit=None)
    return score(parsed, name)


def column_values(raw: RawTable, used: Sequence[UsedColumn]) -> tuple[pd.DataFrame, list[Finding]]:
    """Return the used columns as float64 in SI; NaN where a cell is empty or no finite number, which is said."""
    findings: list[Finding] = []
    values: dict[str, FloatArray] = {}
    for column in used:
        values[column.name], remarks = _values(raw, column)
        findings += remarks
    if raw.ragged:
        lines = {"lines": len(raw.ragged), "numbers": listing(raw.ragged)}
        findings.append(finding("cells ragged", source=raw.source, **lines))
    return pd.DataFrame(values), findings


def _values(raw: RawTable, column: UsedColumn) -> tuple[FloatArray, list[Finding]]:
    place = raw.headers.index(column.header)
    values, branch = raw.column(place), column.name == "branch"
    if np.isfinite(values).all():
        return np.sign(values) if branch else values * column.factor, []
    cells = [cell.strip() for cell in raw.texts(place)]
    moments = clock_seconds(cells, column.header) if column.name in {"time_s", "order"} else None
    if moments is not None:
        return moments, []
    if branch:
        words = np.array([_BRANCH_WORDS.get(cell.casefold(), np.nan) for cell in cells])
        values = np.sign(np.where(np.isfinite(words), words, values))
    empty = np.array([cell.casefold() in EMPTY for cell in cells])
    bad = np.flatnonzero(np.isnan(values) & ~empty)
    if not len(bad):
        return values * column.factor, []
    if column.name in {"run", "mount"}:
        labels = list(dict.fromkeys(cell for cell, missing in zip(cells, empty, strict=True) if not missing))
        listed = listing(f"{k} = {label}" for k, label in enumerate(labels, 1))
        number = {label: float(k) for k, label in enumerate(labels, 1)}
        numbers = [np.nan if missing else number[cell] for cell, missing in zip(cells, empty, strict=True)]
        return np.array(numbers), [finding("labels", column=column.name, labels=listed)]
    below = f" below {LARGEST:g}, as of an overload" if looks_numeric(cells[bad[0]]) else ""
    facts = {"header": quoted(column.header), "cells": len(bad), "below": below, "cell": quoted(cells[bad[0]])}
    return values * column.factor, [finding("cells words", size=float(len(bad)), column=column.name, **facts)]


def column_option(header: str, name: str) -> str:
    """The option that says what a column is, quoted for a shell where it must be.

    Examples
    --------
    >>> print(column_option("CH1 voltage (V)", "voltage_V"), column_option("Kraft", "force_N"))
    --column 'CH1 voltage (V)=voltage_V' --column Kraft=force_N
    """
    fit = quoted(header.strip()) == header.strip()  # neither long nor with control characters
    return "--column " + shlex.quote(f"{header.strip() if fit else 'HEADER'}={name}")


def remedy_for_columns(unused: Sequence[str], needed: Sequence[str]) -> str:
    """What to do where columns are missing: which of the unused ones each may be, by its words or its unit.

    Parameters
    ----------
    needed : sequence of str
        Columns that are missing, or of which one is, the most wanted first.

    Examples
    --------
    >>> for headers in (["run", "force_N"], ["run", "Kanal 1"]):
    ...     print(remedy_for_columns(headers, ["time_s"]).partition("with ")[2])
    --column HEADER=time_s.
    --column 'Kanal 1=time_s'.
    """
    if not unused:
        return f"Add {needed[0]}."
    free = (header for header in unused if max(score(parse_header(header), name) for name in REGISTRY) < Likeness.MAYBE)
    options = column_options(unused, needed, Likeness.WORD, Likeness.UNIT)
    options = options or [column_option(next(free, "HEADER"), needed[0])]
    return (
        f"Not used: {listing(unused, 20)}. Rename columns, or say what they are, for example with {' '.join(options)}."
    )


def column_options(headers: Sequence[str], names: Sequence[str], *enough: int) -> list[str]:
    """The options that say what headers may mean, in their order, each column once; the first score counts most."""
    meant: dict[str, str] = {}
    for least, name in product(enough, names):
        free = (header for header in headers if header not in meant and score(parse_header(header), name) >= least)
        header = next(free, None)
        if header is not None and name not in meant.values():
            meant[header] = name
    return [column_option(header, meant[header]) for header in headers if header in meant]
