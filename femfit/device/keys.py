"""What a key of the actuator file is, declared once: at the field of the record that has its value.

A record is a frozen dataclass, one of each table. Its fields are in SI units, or in the file's where a table is drawn
with; a field's name and its key's say which. How a key is read and converted, whether it can be swept or be off, its
row of the reference page, its JSON Schema and its limits in a model file all follow from the declaration.
"""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from decimal import Decimal
from functools import cache
from types import SimpleNamespace, UnionType
from typing import Any, ClassVar, NamedTuple, dataclass_transform, get_args, get_origin, get_type_hints


def scaled(value: float, exponent: int = -3) -> float:
    """The double nearest to value * 10^exponent, as from mm to m, the value taken with the digits that print it."""
    return float(Decimal(repr(float(value))).scaleb(exponent))


def decimal_sum(offset: float, factor: float, value: float) -> float:
    """The double nearest to offset + factor * value, all three taken with the digits that print them."""
    first, second, third = (Decimal(repr(float(number))) for number in (offset, factor, value))
    return float(first + second * third)


class Unit(NamedTuple):
    """A unit of the file."""

    printed: str
    si: str  # As names of fields end in
    power: int = 0  # Of ten, to that


UNITS = {
    "MJ_per_m3_K": Unit("MJ/(m³ K)", "J_per_m3_K", 6),
    "MS_per_m": Unit("MS/m", "S_per_m", 6),
    "N_per_mm": Unit("N/mm", "N_per_m", 3),
    "V_per_mm": Unit("V/mm", "V_per_m", 3),
    **{name: Unit(printed, name) for name, printed in {
        "W_per_m2_K": "W/(m² K)", "W_per_m_K": "W/(m K)", "W_per_K": "W/K", "N_s_per_m": "N s/m", "m_per_s2": "m/s²",
        "A_per_m": "A/m", "V_per_T": "V/T", "per_K": "1/K", "ohm": "Ω", "deg": "°", "Hz": "Hz", "T": "T", "C": "°C",
        "V": "V", "A": "A", "N": "N",
    }.items()},
    **{name: Unit(name, si, -3) for name, si in {"mm": "m", "ms": "s", "mH": "H", "g": "kg"}.items()},
}  # fmt: skip
"""Units that keys of the file end in, those that others end in behind them."""

SI_UNITS = {name: unit.si for name, unit in UNITS.items() if unit.power == -3}
"""SI units of the units that numbers of the file are in; each of these is a thousandth."""

# These bounds are far beyond any actuator, and keep products of values far from overflow and underflow
LENGTH: dict[str, Any] = {"ge": -1e5, "le": 1e5}
FORCE: dict[str, Any] = {"ge": -1e6, "le": 1e6}
ELECTRICAL = FORCE
POINTS = ((2, 1000),)


Place = tuple[str | int, ...]
"""Where something stands in a file: names, and positions in lists."""


def unit_of(name: str) -> str:
    """The unit that a key or a column ends in, empty for bare numbers."""
    return next((unit for unit in UNITS if name.endswith(f"_{unit}")), "")


class Given(SimpleNamespace):
    """What a table gives: its values by their keys, in the file's units, and what is usual for those left out."""

    stated: set[str]  # Keys that are there
    wrong: set[str]  # Keys that are missing or whose values are no such ones


@dataclass_transform(frozen_default=True, kw_only_default=True)
class Record:
    """Base of the frozen dataclasses of tables, and what one says of its table beside its fields; nothing usually."""

    __dataclass_fields__: ClassVar[dict[str, Any]]
    beside: ClassVar[tuple[Any, ...]] = ()  # Records whose keys stand in the same table
    UNIT: ClassVar[str] = ""  # That keys end in which are named so
    any_keys: ClassVar[bool] = False  # Whether others may be there, which are not read

    def __init_subclass__(cls, *, kw_only: bool = True, eq: bool = True) -> None:
        dataclass(frozen=True, kw_only=kw_only, eq=eq)(cls)

    @classmethod
    def derived(cls, given: Given, complain: Callable[..., None]) -> dict[str, Any]:  # noqa: ARG003  of some records
        """Fields that follow from keys beside them, by their names.

        It complains of values that are right each by itself and wrong together, by codes of ``complaints.toml``, whose
        sentences know what is given, and further facts.
        """
        return {}


@dataclass(frozen=True, eq=False)
class Key:
    """What is said of a key beside its field's type and default; all numbers are in the file's unit."""

    remedy: str  # What to do where it is missing or wrong, as a sentence
    file: str = ""  # Its name there, where it is not the field's; ``{unit}`` is the record's, here and above
    count: tuple[tuple[int, int], ...] = ()  # Fewest and most members of a list, and of the lists in it
    words: tuple[str, ...] = ()  # Names of directions, which may also be given as [r, z]
    usual: Any = None  # What the file takes where it is left out, if that is not the field's default
    required: bool = False  # Whether a table must have it, as where the field has no default
    kind: str = ""  # Of a number that a workshop may miss, of femfit.device.tolerances.KINDS
    ascending: bool = False
    monotone: bool = False  # A list that rises or falls throughout
    like: str = ""  # Key of a list with as many values
    stepped: type | None = None  # Record of a table that may stand for a list, as { start, stop, step }
    form: type | None = None  # Record of a table whose values are read by a reader of its own
    of_device: bool = True  # No table that says how it is solved, heated or used, of which no number is a drawn one
    any_name: bool = False  # Whether the tables may be named as one likes: no column or file is named after them
    limits: Mapping[str, Any] = field(default_factory=dict)  # On each number or text, as pydantic calls them
    # From here on by the field, as :func:`keys_of` fills it in
    field: str = ""
    power: int = 0  # Of ten, from the file's unit to the field's
    hint: Any = None
    records: tuple[Any, ...] = ()  # Of the table here, or of each table that has a name here
    named: bool = False
    is_number: bool = False  # One, with or without None beside it


def converted(value: Any, power: int) -> Any:
    """A value, or each of a list, times a power of ten; lists are tuples."""
    if isinstance(value, list | tuple):
        return tuple(converted(each, power) for each in value)
    return scaled(value, power) if power and value is not None else value


LIMITS = ("ge", "le", "gt", "lt", "min_length", "max_length", "pattern")


def key(says: str, default: Any = MISSING, *, model: Mapping[str, Any] | None = None, **facts: Any) -> Any:
    """A field with its key: what to give, the default in the field's unit, and what :class:`Key` holds besides.

    A model file is held to ``model``, or else to signs, since the drawing's other bounds are far from any actuator.
    """
    limits = {name: facts.pop(name) for name in LIMITS if name in facts}
    signs = {"upper": limits["lt"]} if "lt" in limits else {}
    if limits.get("gt", limits.get("ge", -1.0)) >= 0.0:
        signs |= {"lower": 0.0} if limits.get("ge") == 0.0 else {"positive": True}
    return field(
        default=default,
        metadata={"drawn": Key(f"Give {says}.", limits=limits, **{"usual": ..., **facts}), **signs, **(model or {})},
    )


def _keys_of(record: Any) -> dict[str, Key]:
    """The keys of a record's table: its fields', then its bases', and those of records ``beside`` it in one table."""
    keys = {}
    for each in (record, *record.beside):
        hints, first = get_type_hints(each), vars(each)["__annotations__"]
        declared = [member for member in fields(each) if "drawn" in member.metadata]
        for member in sorted(declared, key=lambda member: member.name not in first):
            bound = _bound(member, hints[member.name], record.UNIT)
            keys[bound.file] = bound
    return keys


def _bound(member: Any, hint: Any, unit: str) -> Key:
    """What is declared at a field, with what follows from its name, type and default."""
    declared: Key = member.metadata["drawn"]
    units = ((name, each.si) for name, each in UNITS.items() if member.name.endswith(f"_{each.si}"))
    place_in_file, si = next(units, ("", ""))
    file = (declared.file or f"{member.name.removesuffix(si)}{place_in_file}").replace("{unit}", unit)
    remedy = declared.remedy.replace("{unit}", unit and UNITS[unit].printed.replace("²", "^2"))
    listed = get_origin(hint) is tuple
    alternatives = get_args(hint) if isinstance(hint, UnionType) or listed else (hint,)
    kinds = [kind for each in alternatives for kind in (each, *get_args(each))]
    records = tuple(kind for kind in kinds if is_dataclass(kind))
    unit, usual = unit_of(file), declared.usual
    power = 0 if not unit or member.name.endswith(f"_{unit}") else UNITS[unit].power
    required = declared.required or (usual is ... and member.default is MISSING)
    if usual is ...:
        usual = None if required or records else converted(member.default, -power)
    bound = replace(declared, field=member.name, hint=hint, remedy=remedy, file=file, records=records, power=power)
    named, is_number = bool(records) and listed, float in alternatives and not listed
    return replace(bound, named=named, is_number=is_number, required=required, usual=usual)


keys_of: Callable[[Any], dict[str, Key]] = cache(_keys_of)


@cache
def kind_of(record: Any) -> str:
    """The ``kind`` by which a table or a model file says which record it is; empty where it has none."""
    names = get_args(get_type_hints(record).get("kind"))
    return str(names[0]) if len(names) == 1 else ""


def in_si(record: Any, given: Given, complain: Callable[..., None], **more: Any) -> Any:
    """The record of a table, its own fields converted; what is not there is as usual."""
    values = {}
    for name, declared in keys_of(record).items():
        member = record.__dataclass_fields__.get(declared.field)
        if member and not declared.records and (name in given.stated or member.default is MISSING):
            value = getattr(given, name)
            values[declared.field] = value if declared.hint is Any else converted(value, declared.power)
    return record(**values | record.derived(given, complain) | more)


_ANY = LENGTH | {"kind": "length"}


class OutlineEntry(Record):
    """A box (r_mm and z_mm), a polygon with arcs (polygon_mm) or a circle (circle_mm)."""

    r_mm: tuple[float, float] | None = key("[inner, outer] radius in mm", None, ascending=True, **_ANY)
    z_mm: tuple[float, float] | None = key("[lower, upper] height in mm", None, ascending=True, **_ANY)
    polygon_mm: tuple[tuple[float, ...], ...] | None = key(
        "at least three corners [[r, z], ...] in mm; a third number is the angle in degrees of an arc to the next "
        "corner, positive counter-clockwise",
        None,
        count=((2, 1000), (2, 3)),
        **_ANY,
    )
    circle_mm: tuple[float, float, float] | None = key(
        "[r, z, radius]: a ball where r is 0, a ring with a round section elsewhere", None, **_ANY
    )
