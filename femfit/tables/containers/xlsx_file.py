"""Sheets of a spreadsheet, each read as the text table that it would be saved as."""

import io
from datetime import datetime
from zipfile import ZipFile

import pandas as pd

from femfit.core.errors import TableError
from femfit.core.finding import listing
from femfit.tables.containers.named_table import NamedTable, require_library
from femfit.tables.text_table import parse_text

LARGEST = 64e6
"""Bytes of unpacked XML. Measured: 320,000 rows of four numbers, which take 13 processor seconds, six times those of
the same rows as CSV."""


def read_xlsx(content: bytes, source: str) -> tuple[list[NamedTable], str]:
    """Tables of a workbook's sheets, and which sheets are none."""
    require_library("openpyxl", "openpyxl", source)
    with ZipFile(io.BytesIO(content)) as book:
        size = sum(member.file_size for member in book.infolist() if member.filename.endswith(".xml"))
    if size > LARGEST:
        raise TableError(
            f"{source} holds {size / 1e6:.0f} MB of cells, and a workbook is read up to {LARGEST / 1e6:.0f} MB. Save "
            "its sheet as CSV, which is read six times as fast."
        )
    sheets = pd.read_excel(io.BytesIO(content), sheet_name=None, header=None, engine="openpyxl")
    tables, charts = [], []
    for name, cells in sheets.items():
        filled = cells.dropna(axis=1, how="all")
        lines = ["\t".join(map(_text, row)) for row in filled.itertuples(index=False)]
        try:
            raw = parse_text("\n".join(lines).encode(), source, encoding="utf-8", delimiter="\t", decimal=".")
        except TableError:
            charts.append(name)
        else:
            tables.append(NamedTable(str(name), raw))
    return tables, f"No table stands in {listing(charts)}." if charts else ""


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
