"""Long tables, one row a point: which column holds what, in which unit."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.finding import Finding, listing
from femfit.core.quoted import quoted
from femfit.tables.column_names import STEP_NAMES
from femfit.tables.foreign.options import QUANTITIES, REQUIRED, ImportOptions, quantity_of, si_unit
from femfit.tables.header import Header, find_header, match_score, parse_header
from femfit.tables.raw_table import RawTable
from femfit.tables.units import given_factor


@dataclass(frozen=True)
class ColumnUse:
    """One quantity's origin: a column (or where else it came from), its unit there and the factor to SI."""

    quantity: str
    header: str
    unit: str
    factor: float
    assumed: bool = False  # True if neither the file nor the user named a unit

    def as_dict(self) -> dict[str, Any]:
        """Return the entry of the manifest."""
        return {
            "quantity": self.quantity,
            "column": QUANTITIES[self.quantity],
            "header": self.header,
            "unit": self.unit,
            "factor_to_SI": self.factor,
            "unit_assumed": self.assumed,
        }


def long_points(
    raw: RawTable, constants: dict[str, float], options: ImportOptions
) -> tuple[pd.DataFrame, dict[str, ColumnUse], list[Finding]]:
    """Read one row a point with SI columns.

    Parameters
    ----------
    constants : dict of str to float
        ``current`` (A) or ``distance`` (m) of the whole file, used where no column holds it.

    Returns
    -------
    points : DataFrame
        Quantities in SI (distance before start and step), ``source``, ``line``; further force columns as
        ``other:<header>``.
    """
    headers = options.column_names or raw.headers
    if not headers:
        raise TableError(
            f"{raw.source} has no header line over its {raw.numbers.shape[1]} columns; name them with "
            "--columns current,distance,force (a dash for one that is not needed). For force(distance, current) give "
            "the currents of its columns: --columns 'd [mm],0 A,0.5 A,1 A'."
        )
    if len(headers) != raw.numbers.shape[1]:
        raise TableError(
            f"{raw.source} has {raw.numbers.shape[1]} columns but {len(headers)} names ({listing(headers, 12)}); give "
            "one name a column with --columns."
        )
    index, rivals = _choose(headers, raw.source, options)
    uses = {name: _use(name, parse_header(headers[k]), raw.source, options) for name, k in index.items()}
    data = {name: raw.numbers[:, k] * uses[name].factor for name, k in index.items()}
    for quantity, value in constants.items():
        if quantity not in uses:
            data[quantity] = np.full(len(raw.lines), value, dtype=np.float64)
            uses[quantity] = ColumnUse(quantity, f"{value:g} for the whole file", si_unit(quantity), 1.0)
    missing = [quantity for quantity in REQUIRED if quantity not in data]
    if missing:
        raise TableError(_missing_message(raw.source, headers, missing))
    points = pd.DataFrame(data)
    for header in rivals.get("force", []):
        points[f"other:{header}"] = raw.numbers[:, headers.index(header)] * uses["force"].factor
    unused = [header for k, header in enumerate(headers) if k not in index.values()]
    return points.assign(source=raw.source, line=raw.lines), uses, _choices(uses, unused, rivals, options)


def unit_use(quantity: str, header: str, unit: str | None, source: str, options: ImportOptions) -> ColumnUse:
    """Return the use of a column in the unit that the user, or else the file, names."""
    unit = options.unit_of(quantity, header) or unit
    if quantity == "distance" and options.distance_step_m is not None:
        return ColumnUse(quantity, header, f"steps of {options.distance_step_m:g} m", options.distance_step_m)
    if unit is None:
        return ColumnUse(quantity, header, si_unit(quantity), 1.0, assumed=True)
    try:
        return ColumnUse(quantity, header, unit, given_factor(unit, si_unit(quantity), header, source))
    except TableError as error:
        raise TableError(f"{error} Give it with --unit {quantity}=UNIT.") from error


def _choose(
    headers: tuple[str, ...], source: str, options: ImportOptions
) -> tuple[dict[str, int], dict[str, list[str]]]:
    """The column of each quantity, and the columns that could be it as well (all of them where none was chosen)."""
    parsed = [parse_header(header) for header in headers]
    chosen: dict[str, int] = {}
    for wanted, name in options.columns.items():
        quantity = quantity_of(name)
        chosen[quantity] = headers.index(find_header(wanted, headers, source, "--column"))
    rivals: dict[str, list[str]] = {}
    for quantity in [name for name in QUANTITIES if name not in options.without]:
        if quantity not in chosen:
            free = {k: header for k, header in enumerate(parsed) if k not in chosen.values()}
            best = _best(free, quantity)
            if len(best) > 1:
                rivals[quantity] = [headers[k] for k in best]
                continue
            if best:
                chosen[quantity] = best[0]
        if quantity in chosen:
            column = QUANTITIES[quantity]
            others = [headers[k] for k, h in enumerate(parsed) if k not in chosen.values() and match_score(h, column)]
            if others:
                rivals[quantity] = others
    for quantity in REQUIRED:
        if quantity in rivals and quantity not in chosen:
            raise TableError(
                f"{source} has several columns that may hold the {quantity}: {listing(rivals[quantity])}. "
                f"Choose one with --column HEADER={quantity}."
            )
    return chosen, rivals


def _best(free: dict[int, Header], quantity: str) -> list[int]:
    scores = {k: match_score(header, QUANTITIES[quantity]) for k, header in free.items()}
    # A column belongs to the quantity that it names best: "flux density" is no flux linkage.
    scores = {
        k: score
        for k, score in scores.items()
        if score and score >= max(match_score(free[k], other) for other in QUANTITIES.values())
    }
    top = max(scores.values(), default=0)
    return [k for k, score in scores.items() if score == top]


def _use(quantity: str, header: Header, source: str, options: ImportOptions) -> ColumnUse:
    counts_steps = quantity == "distance" and header.name in STEP_NAMES and header.unit is None
    if counts_steps and options.distance_step_m is None and options.unit_of("distance", header.text) is None:
        raise TableError(
            f"{source}: column {quoted(header.text)!r} counts steps; give their size with --distance-step-mm and the "
            "first distance with --distance-start-mm."
        )
    return unit_use(quantity, header.text, header.unit, source, options)


def _missing_message(source: str, headers: tuple[str, ...], missing: list[str]) -> str:
    remedies = {
        "current": "--column HEADER=current, or --file-current-A where a file holds one current (or write it in the "
        "file names as in force_0.4A.csv)",
        "distance": "--column HEADER=distance, or --file-distance-mm where a file holds one distance",
        "force": "--column HEADER=force",
    }
    return "\n".join(
        [
            f"{source} has no column that is known as {' or '.join(missing)}; it has {listing(headers, 20)}.",
            *(f"  - {quantity}: give {remedies[quantity]}" for quantity in missing),
        ]
    )


def _choices(
    uses: dict[str, ColumnUse], unused: list[str], rivals: dict[str, list[str]], options: ImportOptions
) -> list[Finding]:
    findings = []
    decided = {quantity_of(name) for name in options.columns.values()}
    undecided = {quantity: headers for quantity, headers in rivals.items() if quantity not in decided}
    for quantity, headers in undecided.items():
        name = quantity.replace("_", " ")
        if quantity in uses:
            text = f"{quoted(uses[quantity].header)} is taken as {name}; it might also be {listing(headers)}."
        else:
            text = f"{listing(headers)} may each be the {name}; none was taken."
        findings.append(Finding("choice", "info", text, f"Choose with --column HEADER={quantity}."))
    left = [header for header in unused if not any(header in headers for headers in undecided.values())]
    if left:
        findings.append(Finding("unused-columns", "info", f"Not used: {listing(left, 20)}."))
    assumed = [f"{quoted(use.header)} in {use.unit}" for use in uses.values() if use.assumed]
    if assumed:
        text = f"No unit given, SI assumed: {', '.join(assumed)}."
        findings.append(Finding("assumed-units", "info", text, "Name it with --unit HEADER=UNIT."))
    return findings
