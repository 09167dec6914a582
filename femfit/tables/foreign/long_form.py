"""Long tables, one row a point; current or distance may come from outside of the table."""

import numpy as np
import pandas as pd

from femfit.core.errors import TableError
from femfit.core.finding import Finding
from femfit.tables.foreign.mapping import ColumnUse, choose_columns
from femfit.tables.foreign.options import ImportOptions
from femfit.tables.foreign.quantities import QUANTITIES, REQUIRED
from femfit.tables.foreign.raw_table import RawTable


def long_points(
    raw: RawTable, constants: dict[str, float], options: ImportOptions
) -> tuple[pd.DataFrame, dict[str, ColumnUse], list[Finding]]:
    """One row a point with SI columns.

    Parameters
    ----------
    constants : dict of str to float
        ``current`` (A) or ``distance`` (m) of the whole file, used where no column holds it.

    Returns
    -------
    points : DataFrame
        Quantities in SI (distance before start and step), ``source``, ``line``; further force columns as
        ``other:<header>``.
    findings : list of Finding
        Choices that were left to the user.

    Raises
    ------
    TableError
        If current, distance or force is missing.
    """
    if not raw.headers:
        raise TableError(
            f"{raw.source} has no header line over its {raw.numbers.shape[1]} columns; name them with "
            "--columns current,distance,force (a dash for one that is not needed), or give --form matrix."
        )
    if len(raw.headers) != raw.numbers.shape[1]:
        raise TableError(
            f"{raw.source} has {raw.numbers.shape[1]} columns but {len(raw.headers)} names "
            f"({', '.join(raw.headers)}); give one name a column with --columns."
        )
    uses, unused, rivals = choose_columns(raw.headers, raw.source, options)
    data = {quantity: raw.column(use.header) * use.factor for quantity, use in uses.items()}
    for quantity, value in constants.items():
        if quantity not in uses:
            data[quantity] = np.full(len(raw.lines), value, dtype=np.float64)
            uses[quantity] = ColumnUse(quantity, f"{value:g} for the whole file", QUANTITIES[quantity].si_unit, 1.0)
    missing = [quantity for quantity in REQUIRED if quantity not in data]
    if missing:
        raise TableError(_missing_message(raw, missing))
    points = pd.DataFrame(data)
    for header in rivals.get("force", []):
        points[f"other:{header}"] = raw.column(header) * uses["force"].factor
    return points.assign(source=raw.source, line=raw.lines), uses, _choices(uses, unused, rivals, options)


def _missing_message(raw: RawTable, missing: list[str]) -> str:
    remedies = {
        "current": "--current-column, or --file-current-A where a file holds one current (or write it in the file "
        "names as in force_0.4A.csv)",
        "distance": "--distance-column, or --file-distance-mm where a file holds one distance",
        "force": "--force-column",
    }
    return "\n".join(
        [
            f"{raw.source} has no column that is known as {' or '.join(missing)}; it has {', '.join(raw.headers)}.",
            *(f"  - {quantity}: give {remedies[quantity]}" for quantity in missing),
        ]
    )


def _choices(
    uses: dict[str, ColumnUse], unused: list[str], rivals: dict[str, list[str]], options: ImportOptions
) -> list[Finding]:
    findings = []
    undecided = {quantity: headers for quantity, headers in rivals.items() if quantity not in options.columns}
    for quantity, headers in undecided.items():
        option = f"--{QUANTITIES[quantity].option}-column"
        name = quantity.replace("_", " ")
        if quantity in uses:
            sentence = f"{uses[quantity].header} is taken as {name}; it might also be {', '.join(headers)}."
        else:
            sentence = f"{', '.join(headers)} may each be the {name}; none was taken."
        findings.append(Finding("choice", "info", sentence, f"Choose with {option}."))
    left = [header for header in unused if not any(header in headers for headers in undecided.values())]
    if left:
        findings.append(Finding("unused-columns", "info", f"Not used: {', '.join(left)}."))
    assumed = [f"{use.header} in {use.unit}" for use in uses.values() if use.assumed]
    if assumed:
        findings.append(
            Finding(
                "assumed-units", "info", f"No unit given, SI assumed: {', '.join(assumed)}.", "Name it with --…-unit."
            )
        )
    return findings
