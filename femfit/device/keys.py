"""What a key of the actuator file is, declared once: at the field of the record that has its value.

A record is a frozen dataclass, one of each table. Its fields are in SI units, or in the file's where a table is drawn
with; a field's name and its key's say which. How a key is read and converted, whether it can be swept or be off, its
row of the reference page, its JSON Schema and its limits in a model file all follow from the declaration.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from decimal import Decimal
from functools import cache, reduce
from operator import or_
from types import SimpleNamespace, UnionType
from typing import Annotated, Any, ClassVar, NamedTuple, dataclass_transform, get_args, get_origin, get_type_hints

from pydantic import AllowInfNan, Field, PlainValidator, Strict, TypeAdapter, WithJsonSchema
from pydantic_core import PydanticCustomError


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

# These bounds are far beyond any actuator, and keep products of values far from overflow and underflow
LENGTH: dict[str, Any] = {"ge": -1e5, "le": 1e5}
FORCE: dict[str, Any] = {"ge": -1e6, "le": 1e6}
ELECTRICAL = FORCE
POINTS = ((2, 1000),)
MAX_DIRECTION = 1e5  # far beyond any direction that is written, and not infinite


Place = tuple[str | int, ...]
"""Where something stands in a file: names, and positions in lists."""


def unit_of(name: str) -> str:
    """The unit that a key or a column ends in, empty for bare numbers."""
    return next((unit for unit in UNITS if name.endswith(f"_{unit}")), "")


class Entry(SimpleNamespace):
    """What a table gives: its values by their keys, in the file's units, and what is usual for those left out."""

    stated: set[str]  # Keys that are there
    wrong: set[str]  # Keys that are missing or whose values are no such ones


@dataclass_transform(frozen_default=True, kw_only_default=True)
class Record:
    """Base of the frozen dataclasses of tables, and what one says of its table beside its fields; nothing usually.

    A key that is a class variable has no field of its own: others follow from it. Keys of a field ``in_same_table`` are
    those of its record.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]
    UNIT: ClassVar[str] = ""  # That keys end in which are named so
    any_keys: ClassVar[bool] = False  # Whether others may be there, which are not read
    needs_more: ClassVar[bool] = False  # Than its table to be made, which is read as an Entry

    def __init_subclass__(cls, *, kw_only: bool = True, eq: bool = True) -> None:
        dataclass(frozen=True, kw_only=kw_only, eq=eq)(cls)
        hints: dict[str, Any] = cls.__annotations__
        for name in (name for name, hint in hints.items() if get_origin(hint) is ClassVar and name in vars(cls)):
            delattr(cls, name)  # It is a key of the file alone

    @classmethod
    def derived(cls, entry: Entry, complain: Callable[..., None]) -> dict[str, Any]:  # noqa: ARG003  of some records
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
    field: str = ""  # None of a class variable
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


def in_same_table(default: Any) -> Any:
    """A field with a record whose keys stand in the table of the record around it."""
    return field(default=default, metadata={"in_same_table": True})


def _keys_of(record: Any) -> dict[str, Key]:
    """The keys of a record's table: its fields', then its bases', and those from which others follow."""
    hints, first = get_type_hints(record), vars(record)["__annotations__"]
    keys: dict[str, Key] = {}
    members = record.__dataclass_fields__.values()
    for member in sorted(members, key=lambda member: (get_origin(member.type) is ClassVar, member.name not in first)):
        if "in_same_table" in member.metadata:
            keys |= keys_of(member.type)
        elif "drawn" in member.metadata:
            bound = _bound(member, hints[member.name], record.UNIT)
            keys[bound.file] = bound
    return keys


keys_of: Callable[[Any], dict[str, Key]] = cache(_keys_of)


def _bound(member: Any, hint: Any, unit: str) -> Key:
    """What is declared at a field, with what follows from its name, type and default."""
    declared: Key = member.metadata["drawn"]
    is_field = get_origin(hint) is not ClassVar
    hint = hint if is_field else get_args(hint)[0]
    units = ((name, each.si) for name, each in UNITS.items() if member.name.endswith(f"_{each.si}"))
    unit_in_file, si = next(units, ("", ""))
    file = (declared.file or f"{member.name.removesuffix(si)}{unit_in_file}").replace("{unit}", unit)
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
    named, is_number, name = bool(records) and listed, float in alternatives and not listed, member.name * is_field
    bound = replace(declared, field=name, hint=hint, remedy=remedy, file=file, records=records, power=power)
    return replace(bound, named=named, is_number=is_number, required=required, usual=usual)


@cache
def kind_of(record: Any) -> str:
    """The ``kind`` by which a table or a model file says which record it is; empty where it has none."""
    names = get_args(get_type_hints(record).get("kind"))
    return str(names[0]) if len(names) == 1 else ""


def in_si(record: Any, entry: Entry, complain: Callable[..., None], **more: Any) -> Any:
    """The record of a table, its own fields converted; what is not there is as usual."""
    keys, values = {key.field: (name, key) for name, key in keys_of(record).items()}, {}
    for member in fields(record):
        name, declared = keys.get(member.name, ("", None))
        if "in_same_table" in member.metadata:
            values[member.name] = in_si(member.type, entry, complain)
        elif declared and not declared.records and (name in entry.stated or member.default is MISSING):
            values[member.name] = converted(getattr(entry, name), declared.power)
    return record(**values | record.derived(entry, complain) | more)


def keys_apart(record: Any, records: Sequence[Any]) -> set[str]:
    """The keys of a record that none of the others has."""
    return set(keys_of(record)).difference(*(keys_of(each) for each in records if each is not record))


@cache
def adapter(key: Key) -> TypeAdapter[Any]:
    """What checks a key's value, as the file has it, and describes it as JSON Schema."""
    if key.words:
        return TypeAdapter(_direction(key))
    return TypeAdapter(dict[str, Any] if key.records or get_origin(key.hint) is Mapping else _limited(key.hint, key))


def _limited(hint: Any, key: Key, depth: int = 0) -> Any:
    """A type as the file has it, with the limits on every number in it."""
    if isinstance(hint, UnionType):
        return reduce(or_, (_limited(each, key, depth) for each in get_args(hint)))
    if get_origin(hint) is tuple:
        inner, *rest = get_args(hint)
        least, most = key.count[depth] if key.count else (1 + len(rest),) * 2
        return Annotated[list[_limited(inner, key, depth + 1)], Field(min_length=least, max_length=most), Strict()]  # type: ignore[misc]
    if hint is str:
        return Annotated[str, Strict(), Field(**key.limits)]
    if hint in (float, int):
        limited = Annotated[hint, Strict(), Field(**key.limits)]
        return Annotated[limited, AllowInfNan(False)] if hint is float else limited
    return Annotated[bool, Strict()] if hint is bool else hint


def _direction(key: Key) -> Any:
    """A direction by one of the key's names or as [r, z]."""

    def checked(value: Any) -> Any:
        numbers = [number for number in value if type(number) in {int, float}] if isinstance(value, list) else []
        usable = len(numbers) == 2 == len(value) and all(abs(number) < MAX_DIRECTION for number in numbers)
        if value is None or (isinstance(value, str) and value in key.words) or (usable and any(numbers)):
            return value
        needed = "have a length" if usable else f"be {' or '.join(map(repr, key.words))} or a direction [r, z]"
        raise PydanticCustomError("direction", "Input should {needed}", {"needed": needed})

    return Annotated[Any, PlainValidator(checked), WithJsonSchema({"anyOf": [{"enum": [*key.words]}, _PAIR]})]


_PAIR = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}


_ANY = LENGTH | {"kind": "length"}


class Outline(Record):
    """A box (r_mm and z_mm), a polygon with arcs (polygon_mm) or a circle (circle_mm)."""

    r_mm: ClassVar[tuple[float, float] | None] = key("[inner, outer] radius in mm", None, ascending=True, **_ANY)
    z_mm: ClassVar[tuple[float, float] | None] = key("[lower, upper] height in mm", None, ascending=True, **_ANY)
    polygon_mm: ClassVar[tuple[tuple[float, ...], ...] | None] = key(
        "at least three corners [[r, z], ...] in mm; a third number is the angle in degrees of an arc to the next "
        "corner, positive counter-clockwise",
        None,
        count=((2, 1000), (2, 3)),
        **_ANY,
    )
    circle_mm: ClassVar[tuple[float, float, float] | None] = key(
        "[r, z, radius]: a ball where r is 0, a ring with a round section elsewhere", None, **_ANY
    )
