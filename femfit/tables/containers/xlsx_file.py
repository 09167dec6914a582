"""Sheets of a spreadsheet, each read as the text table that it would be saved as."""

import io
import warnings
from datetime import datetime

import pandas as pd

from femfit.core.errors import TableError
from femfit.core.finding import listing
from femfit.tables.containers.named_table import NamedTable, library
from femfit.tables.text_table import parse_text


def read_xlsx(content: bytes, source: str) -> tuple[list[NamedTable], str]:
    """Tables of a workbook's sheets, and which sheets are none."""
    library("openpyxl", "openpyxl", source)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # openpyxl tells of styles and validations, which no number depends on
        sheets = pd.read_excel(io.BytesIO(content), sheet_name=None, header=None, engine="openpyxl")
    tables, others = [], []
    for name, cells in sheets.items():
        filled = cells.dropna(axis=1, how="all")
        lines = ["\t".join(map(_text, row)) for row in filled.itertuples(index=False)]
        try:
            raw = parse_text("\n".join(lines).encode(), source, encoding="utf-8", delimiter="\t", decimal=".")
        except TableError:
            others.append(name)
        else:
            tables.append(NamedTable(str(name), raw))
    return tables, f"No table stands in {listing(others)}." if others else ""


def _text(cell: object) -> str:
    """A cell as CSV has it, with a decimal point."""
    if pd.isna(cell):  # type: ignore[call-overload]
        return ""
    if isinstance(cell, bool):
        return str(int(cell))
    if isinstance(cell, datetime):
        return cell.isoformat()
    text = " ".join(str(cell).split())
    return '"' + text.replace('"', '""') + '"' if '"' in text else text
