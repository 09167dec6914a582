"""A ``.fem`` file to its model: text, numbers, units, references from one list to another.

FEMM 4.0 file format: ``[Key] = value`` lines; properties as ``<BeginX> ... <EndX>`` blocks of ``<Key> = value``; lists
as ``[NumX] = n`` followed by n rows. Keys are read without regard to case; what follows ``[Solution]`` (an ``.ans``
file) is left alone. What blocks and rows hold stands in ``format.toml``.
"""

import math
import re
import shlex
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from typing import Any, NamedTuple

from femfit.core.errors import FemFileError
from femfit.core.text import counted, quoted
from femfit.tables.femm import model
from femfit.tables.units import unit_factor

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


_PARTS = tomllib.loads(files("femfit.tables.femm").joinpath("format.toml").read_text("utf-8"))
_VALUES = {
    name: [_Value(*shlex.split(line)) for line in part["values"].strip("\n").splitlines()]
    for name, part in _PARTS.items()
}


def _label(flags: int = 0, material: model.FemMaterial | None = None, **values: Any) -> model.FemLabel:
    external, default = bool(flags & 1), bool(flags & 2)
    return model.FemLabel(0, material=material or model.NO_MESH, external=external, default=default, **values)


_RECORDS: dict[str, Callable[..., Any]] = {
    name: getattr(model, part.get("record", ""), _label) for name, part in _PARTS.items()
}


@dataclass
class _Reader:
    """Values from their texts; what cannot be read is a problem, and something else is gone on with."""

    unit_mm: float = 1.0
    problems: list[str] = field(default_factory=list)
    made: dict[str, list[Any]] = field(default_factory=dict)  # The entries of each part that was read

    def fault(self, problem: str, otherwise: Any = 0) -> Any:
        """Note a problem."""
        self.problems.append(problem)
        return otherwise

    def record(self, name: str, n: int, entry: Sequence[str] | Mapping[str, str]) -> Any:
        """What an entry is in the model; None for a row that is too short."""
        values, what = _VALUES[name], _PARTS[name]["what"]
        if isinstance(entry, Mapping):
            where = f"{what} {_unquoted(entry.get(values[0].key, ''))!r}: "
            texts = [(value, entry[value.key]) for value in values if value.key in entry]
        else:
            where, needed = f"{what} {n}: its ", sum(value.missing is None for value in values)
            if len(entry) < needed:
                return self.fault(f"{what} {n} has {counted(len(entry), 'value')}; it needs {needed} at least.", None)
            rest = [value.missing or "" for value in values[len(entry) :]]
            texts = list(zip(values, [*entry, *rest], strict=False))
        read = {value.field: self.value(value.kind, text, where + value.key) for value, text in texts}
        read.pop("-", None)
        return _RECORDS[name](**{"name": ""} | read if isinstance(entry, Mapping) else read)

    def value(self, kind: str, text: str, where: str) -> Any:
        """A value by its kind, or the entry that a reference names: points count from 0, properties from 1."""
        if kind not in self.made:
            return getattr(self, kind)(text, where)
        entries, of_points, place = self.made[kind], kind == "numpoints", self.integer(text, where)
        index = place if of_points else max(place, 0) - 1  # 0 or less is no property
        if index >= len(entries) or (of_points and index < 0):
            there = f"there are points 0 to {len(entries) - 1}" if of_points else f"the file defines {len(entries)}"
            return self.fault(f"{where} is number {place}; {there}.", None)
        return entries[index] if index >= 0 else None

    def text(self, text: str, _: str) -> str:
        """A name."""
        return _unquoted(text)

    def number(self, text: str, where: str) -> float:
        """A finite number."""
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        problem = f"{where} must be a number; instead received {text[:40]!r}. Save it again with FEMM."
        return value if math.isfinite(value) else float(self.fault(problem))

    def integer(self, text: str, where: str) -> int:
        """A whole number of at most nine digits."""
        value = self.number(text, where)
        counts = value.is_integer() and abs(value) <= 1e9
        return int(value if counts else self.fault(f"{where} must be a whole number; instead received {text[:40]!r}."))

    def length(self, text: str, where: str) -> float:
        """A length in mm within the limits of a drawing."""
        number = round(self.unit_mm * self.number(text, where), DIGITS) + 0.0  # no minus zero
        if abs(number) > LARGEST_MM:
            self.fault(f"{where} is {number:g} mm; lengths must be within {LARGEST_MM:g} mm.")
        return number

    def span(self, text: str, where: str) -> float:
        """An angle in degrees."""
        number = self.number(text, where)
        if not 0 < number < 360:
            self.fault(f"{where} must lie between 0 and 360 degrees; it is {number:g}.")
        return number

    def curve(self, text: str, where: str) -> tuple[tuple[float, float], ...]:
        """Points B and H, one a line."""
        points = [row.split() for row in text.splitlines()]
        if any(len(row) < 2 for row in points):
            self.fault(f"{where}: each point must be B and H.")
            return ()
        return tuple((self.number(b, f"{where}: B"), self.number(h, f"{where}: H")) for b, h, *_ in points)

    def block(self, text: str) -> dict[str, str]:
        """The values of a block by their keys; a curve's are the lines of its points."""
        lines = text.strip().splitlines()
        block = {match[1].lower(): match[2].strip() for match in map(_PROPERTY.match, lines) if match}
        if "bhpoints" in block:
            curve = [line for line in lines if not line.startswith("<")]
            self.check_count(f"BHPoints of block {block.get('blockname', '')}", block["bhpoints"], len(curve))
            block["bhpoints"] = "\n".join(curve)
        return block

    def check_count(self, what: str, value: str, count: int) -> None:
        """Whether as many entries follow as a line says."""
        if value != str(count):
            says = f"{what} says {quoted(value, 40) or 'nothing'} but {count} follow"
            self.fault(f"{says}; the file is cut or edited wrongly.")


def _unquoted(text: str) -> str:
    """A quoted name without its quotes and without control characters."""
    return "".join(character for character in text.strip().strip('"') if character.isprintable())[:60]


def _sections(content: bytes, source: str) -> Iterator[tuple[str, str, list[str]]]:
    """Key and value of each ``[Key] = value``, with the lines that follow it."""
    if b"\x00" in content:
        raise FemFileError(source, ["it is no text file. Give a .fem file as FEMM's Save writes it."])
    try:
        decoded = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        decoded = content.decode("latin-1")
    for section in filter(str.strip, re.split(r"(?m)^\s*(?=\[)", decoded)[1:]):
        head, *body = [line.strip() for line in section.splitlines() if line.strip()]
        match = _KEY.match(head)
        if match and match[1].lower() == "solution":
            return
        if match:
            yield match[1], match[2].strip(), body


def parse_fem(content: bytes, source: str) -> model.FemModel:
    """Read a FEMM magnetics file."""
    reader, header, entries = _Reader(), dict[str, str](), dict[str, list[Any]]()
    for key, value, body in _sections(content, source):
        name = key.lower()
        if name not in _PARTS:
            header[name] = value.strip('"').strip()
            continue
        if name.startswith("num"):
            entries[name] = [_FIELD.findall(line) for line in body]
        else:
            entries[name] = list(map(reader.block, re.split(r"(?i)<Begin\w+>", "\n".join(body))[1:]))
        reader.check_count(key, value, len(entries[name]))
    there = header.keys() | entries.keys()
    if missing := [name for name in ("Format", "NumPoints", "NumBlockLabels") if name.lower() not in there]:
        lacks = ", ".join(f"[{name}]" for name in missing)
        what = f"it is no FEMM magnetics file of format 4.0: {lacks} missing."
        raise FemFileError(source, [f"{what} Give a .fem file as FEMM saves it."])
    unit = header.get("lengthunits", "").lower()
    if (unit_m := unit_factor(unit or "inches", "m")) is None:
        needed = "inches, millimeters, centimeters, mils, microns, micrometers or meters"
        unit_m = reader.fault(f"[LengthUnits] must be {needed}; instead received {unit[:40]!r}.", 1.0)
    reader.unit_mm = 1e3 * unit_m
    for name, kind in _PARTS.items():
        numbered = enumerate(entries.get(name, ()), kind.get("first", 0))
        reader.made[name] = [reader.record(name, n, entry) for n, entry in numbered]
    frequency, made = reader.number(header.get("frequency", "0"), "[Frequency]"), reader.made
    if reader.problems:
        raise FemFileError(source, list(dict.fromkeys(reader.problems)))
    return model.FemModel(
        source=source,
        problem_type=header.get("problemtype", "planar").lower(),
        frequency=frequency,
        unit=unit,
        comment=_unquoted(header.get("comment", "")),
        points=tuple(made["numpoints"]),
        lines=(*made["numsegments"], *made["numarcsegments"]),
        labels=tuple(replace(x, number=n) for n, x in enumerate((*made["numblocklabels"], *made["numholes"]), 1)),
    )
