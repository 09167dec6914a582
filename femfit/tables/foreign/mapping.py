"""Which column of a foreign table holds what, and in which unit."""

import math
from dataclasses import dataclass
from typing import Any

from femfit.core.errors import TableError
from femfit.tables.foreign.header import match_score
from femfit.tables.foreign.options import ImportOptions
from femfit.tables.foreign.quantities import QUANTITIES, STEP_NAMES
from femfit.tables.header import Header, parse_header
from femfit.tables.units import UNITS, unit_factor


@dataclass(frozen=True)
class ColumnUse:
    """One quantity's origin.

    Parameters
    ----------
    quantity : str
        A key of :data:`femfit.tables.foreign.quantities.QUANTITIES`.
    header : str
        Column of the file, or where else the value came from.
    unit : str
        As written, or the SI unit that was assumed.
    assumed : bool
        True if neither the file nor the user named a unit.
    """

    quantity: str
    header: str
    unit: str
    factor: float
    assumed: bool = False

    def as_dict(self) -> dict[str, Any]:
        """For the manifest."""
        return {
            "quantity": self.quantity,
            "column": QUANTITIES[self.quantity].column,
            "header": self.header,
            "unit": self.unit,
            "factor_to_SI": self.factor,
            "unit_assumed": self.assumed,
        }


def choose_columns(
    headers: tuple[str, ...], source: str, options: ImportOptions
) -> tuple[dict[str, ColumnUse], list[str], dict[str, list[str]]]:
    """Find the column of each quantity.

    Returns
    -------
    rivals : dict of str to list of str
        Quantity to the columns that could be it as well (all of them where no choice was made).

    Raises
    ------
    TableError
        If a named column does not exist, a required one is ambiguous, or a unit is unknown.
    """
    parsed = [parse_header(header) for header in headers]
    chosen: dict[str, int] = {}
    for quantity, wanted in options.columns.items():
        chosen[quantity] = _find_named(wanted, headers, quantity, source)
    rivals: dict[str, list[str]] = {}
    for quantity in [name for name in QUANTITIES if name not in options.without]:
        if quantity not in chosen:
            free = {index: header for index, header in enumerate(parsed) if index not in chosen.values()}
            best = _best(free, quantity)
            if len(best) > 1:
                rivals[quantity] = [headers[index] for index in best]
                continue
            if best:
                chosen[quantity] = best[0]
        if quantity in chosen:
            others = [headers[i] for i, h in enumerate(parsed) if i not in chosen.values() and match_score(h, quantity)]
            if others:
                rivals[quantity] = others
    for quantity in ("current", "distance", "force"):
        if quantity in rivals and quantity not in chosen:
            raise TableError(
                f"{source} has several columns that may hold the {quantity}: {', '.join(rivals[quantity])}. "
                f"Choose one with --{QUANTITIES[quantity].option}-column."
            )
    uses = {quantity: _use(quantity, parsed[index], source, options) for quantity, index in chosen.items()}
    unused = [header for index, header in enumerate(headers) if index not in chosen.values()]
    return uses, unused, rivals


def unit_use(quantity: str, header: str, unit: str | None, source: str, options: ImportOptions) -> ColumnUse:
    """The factor to SI of a quantity with a unit that the user or the file names.

    Raises
    ------
    TableError
        If the unit is unknown.
    """
    si_unit = QUANTITIES[quantity].si_unit
    given = options.units.get(quantity)
    if given is not None:
        unit = given
    if quantity == "distance" and options.distance_step_m is not None:
        return ColumnUse(quantity, header, f"steps of {options.distance_step_m:g} m", options.distance_step_m)
    if unit is None:
        return ColumnUse(quantity, header, si_unit, 1.0, assumed=True)
    factor = unit_factor(unit, si_unit)
    if factor is None and given is not None:
        try:
            factor = float(given)
        except ValueError:
            factor = None
    option = QUANTITIES[quantity].option
    if factor is None or not math.isfinite(factor) or factor == 0:
        raise TableError(
            f"{source}: {unit!r} of column {header!r} is no unit of {quantity.replace('_', ' ')}; "
            f"give --{option}-unit with one of "
            f"{', '.join(list(UNITS[si_unit])[:6])}... or a number that multiplies the column to {si_unit}."
        )
    return ColumnUse(quantity, header, unit, factor)


def _use(quantity: str, header: Header, source: str, options: ImportOptions) -> ColumnUse:
    if (
        quantity == "distance"
        and "".join(header.words) in STEP_NAMES
        and header.unit is None
        and options.distance_step_m is None
        and "distance" not in options.units
    ):
        raise TableError(
            f"{source}: column {header.text!r} counts steps; give their size with --distance-step-mm and the first "
            "distance with --distance-start-mm."
        )
    return unit_use(quantity, header.text, header.unit, source, options)


def _find_named(wanted: str, headers: tuple[str, ...], quantity: str, source: str) -> int:
    folded = [header.casefold().strip() for header in headers]
    key = wanted.casefold().strip()
    names = [" ".join(parse_header(header).words) for header in headers]
    for candidates, text in ((folded, key), (names, " ".join(parse_header(wanted).words))):
        if candidates.count(text) == 1:
            return candidates.index(text)
    raise TableError(
        f"{source} has no single column {wanted!r} for --{QUANTITIES[quantity].option}-column; its columns are "
        f"{', '.join(headers) or 'without names (give --columns)'}."
    )


def _best(free: dict[int, Header], quantity: str) -> list[int]:
    scores = {index: match_score(header, quantity) for index, header in free.items()}
    # A column belongs to the quantity that it names best: "flux density" is no flux linkage.
    scores = {
        index: score
        for index, score in scores.items()
        if score and score >= max(match_score(free[index], other) for other in QUANTITIES)
    }
    top = max(scores.values(), default=0)
    return [index for index, score in scores.items() if score == top]
