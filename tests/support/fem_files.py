"""The FEMM drawing ``tables/fem/suspension.fem`` in another unit, upside down or shifted along z."""

import re
from pathlib import Path

SUSPENSION = (Path(__file__).parents[1] / "tables" / "fem" / "suspension.fem").read_text(encoding="utf-8")
UNIT_MM = {"inches": 25.4, "millimeters": 1.0, "centimeters": 10.0, "mils": 0.0254, "microns": 1e-3, "meters": 1e3}


def suspension(unit="millimeters", *, below=False, face=0.0):
    """A steel core in a coil, a magnet before its face, which is at so many mm in the file."""

    def placed(match):
        r, z = float(match[1]), face + (-float(match[2]) if below else float(match[2]))
        return f"{r / UNIT_MM[unit]!r}\t{z / UNIT_MM[unit]!r}\t"

    head, points, lines, arcs, holes, labels = re.split(r"(?m)^(?=\[Num)", SUSPENSION)
    points, labels = (re.sub(r"(?m)^(-?[\d.]+)\t(-?[\d.]+)\t", placed, rows) for rows in (points, labels))
    arcs = re.sub(r"(?m)^(\d+)\t(\d+)\t", r"\2\t\1\t", arcs) if below else arcs
    return "".join([head.replace("= millimeters", f"= {unit}"), points, lines, arcs, holes, labels])
