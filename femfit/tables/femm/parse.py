"""A ``.fem`` file to its model: text, numbers, units, references from one list to another.

FEMM 4.0 file format: ``[Key] = value`` lines; properties as ``<BeginX> ... <EndX>`` blocks of ``<Key> = value``; lists
as ``[NumX] = n`` followed by n rows. Keys are read without regard to case; what follows ``[Solution]`` (an ``.ans``
file) is left alone. What blocks and rows hold stands in ``format.toml``.
"""

import math
import re
import shlex
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from typing import Any, NamedTuple

from femfit.core.errors import FemFileError
from femfit.core.text import counted
from femfit.tables.femm.model import (
    NO_MESH,
    FemBoundary,
    FemCircuit,
    FemLabel,
    FemLine,
    FemMaterial,
    FemModel,
    FemPoint,
    FemPointProperty,
)

UNITS_MM = {
    "inches": 25.4,
    "millimeters": 1.0,
    "centimeters": 10.0,
    "mils": 0.0254,
    "microns": 1e-3,
    "micrometers": 1e-3,
    "meters": 1e3,
}
"""FEMM's length units in mm (the inch is exact)."""

DIGITS = 6
"""Decimals of a millimetre that coordinates are kept with: a nanometre, beyond any drawing."""

LARGEST_MM = 1e5
"""As in actuator files."""

_KEY = re.compile(r"\[(\w+)\]\s*=?\s*(.*)")
_PROPERTY = re.compile(r"<(\w+)>\s*=?\s*(.*)")
_FIELD = re.compile(r'"[^"]*"?|\S+')


class _Value(NamedTuple):
    """A value of a block or a row."""

    field: str
    key: str
    kind: str
    missing: str | None = None


class _Part(NamedTuple):
    """What the entries of a list are."""

    what: str
    values: list[_Value]
    first: int


_PARTS = {
    name: _Part(
        entry["what"],
        [_Value(*shlex.split(line)) for line in entry["values"].strip("\n").splitlines()],
        entry.get("first", 0),
    )
    for name, entry in tomllib.loads(files("femfit.tables.femm").joinpath("format.toml").read_text("utf-8")).items()
}


def _label(flags: int = 0, material: FemMaterial | None = None, **values: Any) -> FemLabel:
    return FemLabel(0, material=material or NO_MESH, external=bool(flags & 1), default=bool(flags & 2), **values)


_RECORDS: Mapping[str, Callable[..., Any]] = {
    "pointprops": FemPointProperty,
    "bdryprops": FemBoundary,
    "blockprops": FemMaterial,
    "circuitprops": FemCircuit,
    "numpoints": FemPoint,
    "numsegments": FemLine,
    "numarcsegments": FemLine,
    "numblocklabels": _label,
    "numholes": _label,
}


class _Reader:
    """A file's header, and the records of its parts; what cannot be read is a problem, and nothing is made of it."""

    def __init__(self, content: bytes, source: str) -> None:
        self.source = source
        self.problems: list[str] = []
        self.header: dict[str, str] = {}
        entries = self.split(content)
        there = self.header.keys() | entries.keys()
        missing = [name for name in ("[Format]", "[NumPoints]", "[NumBlockLabels]") if name[1:-1].lower() not in there]
        if missing:
            what = f"it is no FEMM magnetics file of format 4.0: {', '.join(missing)} missing."
            raise FemFileError(self.source, [f"{what} Give a .fem file as FEMM saves it."])
        self.unit = self.header.get("lengthunits", "inches").lower()
        if self.unit not in UNITS_MM:
            units = ", ".join(UNITS_MM)
            self.problems.append(f"[LengthUnits] must be one of {units}; instead received {self.unit[:40]!r}.")
        self.made: dict[str, list[Any]] = {}
        for name, kind in _PARTS.items():
            self.made[name] = [self.record(name, *entry) for entry in enumerate(entries.get(name, ()), kind.first)]

    def split(self, content: bytes) -> dict[str, list[Any]]:
        """Fill the header; each part's entries as text, blocks by their keys and rows by place."""
        if b"\x00" in content:
            raise FemFileError(self.source, ["it is no text file. Give a .fem file as FEMM's Save writes it."])
        try:
            decoded = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            decoded = content.decode("latin-1")
        entries: dict[str, list[Any]] = {}
        for section in filter(str.strip, re.split(r"(?m)^\s*(?=\[)", decoded)[1:]):
            head, *body = [line.strip() for line in section.splitlines() if line.strip()]
            match = _KEY.match(head)
            if match is None:
                continue
            key, value = match[1].lower(), match[2].strip()
            if key == "solution":
                break
            if key not in _PARTS:
                self.header[key] = value.strip('"').strip()
                continue
            if key.startswith("num"):
                entries[key] = [_FIELD.findall(line) for line in body]
            else:
                blocks = re.split(r"(?i)<Begin\w+>", "\n".join(body))[1:]
                entries[key] = [self.block(block.strip().splitlines()) for block in blocks]
            self.check_count(match[1], value, len(entries[key]))
        return entries

    def block(self, lines: list[str]) -> dict[str, str]:
        """The values of a block by their keys; a curve's are the lines of its points."""
        keys = (match for line in lines if (match := _PROPERTY.match(line)))
        block = {match[1].lower(): match[2].strip() for match in keys}
        if "bhpoints" in block:
            curve = [line for line in lines if not line.startswith("<")]
            self.check_count(f"BHPoints of block {block.get('blockname', '')}", block["bhpoints"], len(curve))
            block["bhpoints"] = "\n".join(curve)
        return block

    def check_count(self, what: str, value: str, count: int) -> None:
        """Whether as many rows follow as a line says."""
        if value != str(count):
            says = f"{what} says {value[:40] or 'nothing'} but {count} follow"
            self.problems.append(f"{says}; the file is cut or edited wrongly.")

    def record(self, name: str, n: int, entry: Sequence[str] | Mapping[str, str]) -> Any:
        """What an entry is in the model; None for a row that is too short."""
        kind = _PARTS[name]
        if isinstance(entry, Mapping):
            where = f"{kind.what} {_unquoted(entry.get(kind.values[0].key, ''))!r}: "
            texts = {value: entry[value.key] for value in kind.values if value.key in entry}
        else:
            where, needed = f"{kind.what} {n}", sum(value.missing is None for value in kind.values)
            if len(entry) < needed:
                self.problems.append(f"{where} has {counted(len(entry), 'value')}; it needs {needed} at least.")
                return None
            rest = [value.missing or "" for value in kind.values[len(entry) :]]
            texts, where = dict(zip(kind.values, [*entry, *rest], strict=False)), f"{where}: its "
        read = {value.field: self.value(value.kind, text, where + value.key) for value, text in texts.items()}
        read.pop("-", None)
        return _RECORDS[name](**{"name": ""} | read if isinstance(entry, Mapping) else read)

    def value(self, kind: str, text: str, where: str) -> Any:
        """A value by its kind; a problem and what can be gone on with where it is none."""
        if kind in self.made:
            return self.referenced(kind, self.integer(text, where), where)
        if kind in {"length", "span"}:
            return self.measured(kind, self.number(text, where), where)
        kinds: dict[str, Callable[[str, str], Any]] = {
            "number": self.number,
            "integer": self.integer,
            "curve": self.curve,
        }
        return kinds[kind](text, where) if kind in kinds else _unquoted(text)

    def measured(self, kind: str, number: float, where: str) -> float:
        """A length in mm, or an angle in degrees, within the limits of a drawing."""
        problem = ""
        if kind == "length":
            number = round(UNITS_MM.get(self.unit, 1.0) * number, DIGITS) + 0.0  # no minus zero
            if abs(number) > LARGEST_MM:
                problem = f"{where} is {number:g} mm; lengths must be within {LARGEST_MM:g} mm."
        elif not 0 < number < 360:
            problem = f"{where} must lie between 0 and 360 degrees; it is {number:g}."
        self.problems += [problem] if problem else []
        return 0.0 if problem else number

    def curve(self, text: str, where: str) -> tuple[tuple[float, float], ...]:
        """Points B and H, one a line."""
        points = [row.split() for row in text.splitlines()]
        if any(len(row) < 2 for row in points):
            self.problems.append(f"{where}: each point must be B and H.")
            return ()
        return tuple((self.number(b, f"{where}: B"), self.number(h, f"{where}: H")) for b, h, *_ in points)

    def number(self, text: str, where: str) -> float:
        """A finite number; a problem and 0 if it is none."""
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            self.problems.append(f"{where} must be a number; instead received {text[:40]!r}. Save it again with FEMM.")
            return 0.0
        return value

    def integer(self, text: str, where: str) -> int:
        """A whole number of at most nine digits; a problem and 0 if it is none."""
        value = self.number(text, where)
        if not value.is_integer() or abs(value) > 1e9:
            self.problems.append(f"{where} must be a whole number; instead received {text[:40]!r}.")
            return 0
        return int(value)

    def referenced(self, name: str, place: int, where: str) -> Any:
        """The entry that a reference names: points count from 0; properties from 1, and 0 or less is none."""
        entries, of_points = self.made[name], name == "numpoints"
        index = place if of_points else place - 1
        if index >= len(entries) or (of_points and index < 0):
            there = f"there are points 0 to {len(entries) - 1}" if of_points else f"the file defines {len(entries)}"
            self.problems.append(f"{where} is number {place}; {there}.")
            return None
        return entries[index] if index >= 0 else None


def _unquoted(text: str) -> str:
    """A quoted name without its quotes and without control characters."""
    return "".join(character for character in text.strip().strip('"') if character.isprintable())[:60]


def parse_fem(content: bytes, source: str) -> FemModel:
    """Read a FEMM magnetics file."""
    reader = _Reader(content, source)
    header, made = reader.header, reader.made
    model = FemModel(
        source=source,
        problem_type=header.get("problemtype", "planar").lower(),
        frequency=reader.number(header.get("frequency", "0"), "[Frequency]"),
        unit=reader.unit,
        comment=_unquoted(header.get("comment", "")),
        points=tuple(made["numpoints"]),
        lines=(*made["numsegments"], *made["numarcsegments"]),
        labels=(),
    )
    if reader.problems:
        raise FemFileError(source, list(dict.fromkeys(reader.problems)))
    labels = enumerate((*made["numblocklabels"], *made["numholes"]), 1)
    return replace(model, labels=tuple(replace(label, number=n) for n, label in labels))
