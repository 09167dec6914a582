"""Values of a JSON object, each checked where it is read and named by its key path in every message.

A record of the model file is a dataclass: what its fields are, and what their metadata say, is how it is read and how
it is written. The metadata of a field are

============================  ========================================================================================
``key``                       the member's name where it is not the field's; None of a field that no file has
``flat``, ``given``           the members of this record stand beside the others; what of it no file has
``form``                      the record that stands for it in a file, with ``of`` and ``value``
``kinds``                     the classes of which it is one, told by their ``kind`` or by a key of their own
``omit``, ``required``        not written where it is as usual; never absent though there is a default
``positive``, ``lower`` ...   limits of a number, with ``upper`` and ``within``; ``not_below`` and ``above`` name fields
``ascending``, ``monotone``   of numbers in a list; as many as those of the field in ``like``
``least``                     least length of a list
``open``                      of a pair, whose infinite numbers are null
``degree``                    of clamped knots, the field that has their degree
``shape``, ``dimensions``     of an array: what the members before it ask for, or how many axes it may have
``item``                      of a text, what looks it up
``keys``, ``among``           of a mapping: those that the members before it ask for; those that there may be
============================  ========================================================================================

A record that has ``faults`` is asked for them: keys, each with what stands there in place of what is needed.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from functools import cache
from math import inf, isinf
from types import SimpleNamespace, UnionType
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from femfit.core.errors import ModelFileError, UsageError
from femfit.core.numerics import FloatArray
from femfit.core.text import counted
from femfit.device.electrics import Circuit, Drive, Sensor
from femfit.device.mechanics import ForceTable, Mechanics, Spring, Stop
from femfit.model.bspline import is_clamped

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Item = TypeVar("Item")
Record = TypeVar("Record", bound="DataclassInstance")

_PLAIN = (float, int, bool, str)

_LARGEST = 1e60
"""Derived: products of five such numbers are finite. No quantity of an actuator comes near it."""

_SMALLEST = 1 / _LARGEST
"""Derived: one over it is still such a number, and what must be > 0 is divided by."""

_SPARSE = Mechanics, Spring, ForceTable, Stop, Circuit, Drive, Sensor
"""Of these a file has what is not as usual, and what is in :data:`_ALWAYS`."""

_ALWAYS = ("mass_kg", "gravity_m_s2", "kind", "unit")


@dataclass(frozen=True)
class Section:
    """A JSON object and where it stands."""

    source: str
    path: str  # Keys that lead to it, joined by dots; empty at the top
    data: Mapping[str, Any]

    def where(self, key: str) -> str:
        """Key path of a member."""
        return f"{self.path}.{key}" if self.path else key

    def refusal(self, key: str, needed: str) -> ModelFileError:
        """The error for a member that is missing or not what is needed; it may be one of a member, as ``a[0].b``."""
        value: Any = self.data
        for step in re.findall(r"[^.\[\]]+", key):
            value = value[int(step)] if isinstance(value, list) else value.get(step, MISSING)
        given = "it is missing" if value is MISSING else f"instead received {_short(value)}"
        return ModelFileError(
            f"{self.source} is damaged: {self.where(key)} must be {needed}; {given}. Write it again with femfit fit."
        )

    def refuse_others(self, known: tuple[str, ...]) -> None:
        """Refuse members that this femfit does not know, for what they would change is unknown too."""
        for key in self.data:
            if key not in known:
                raise ModelFileError(
                    f"{self.source} has the unknown key {self.where(key)} (known: {', '.join(known)}). Correct its "
                    "spelling, or update femfit."
                )

    def number(self, key: str, *, lower: float = -inf, upper: float = inf, positive: bool = False) -> float:
        """A finite number within limits, or > 0 where ``positive``."""
        value = self.data.get(key)
        needed = "a finite number" + (" > 0" if positive else f" >= {lower:g}" if np.isfinite(lower) else "")
        if np.isfinite(upper):
            needed = f"a finite number of {lower:g} to {upper:g}"
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.refusal(key, needed)
        if abs(value) >= _LARGEST:
            needed += f", of less than {_LARGEST:g}"
        if positive and 0 < value < _SMALLEST:
            raise self.refusal(key, f"{needed}, of at least {_SMALLEST:g}")
        if not (abs(value) < _LARGEST and lower <= value <= upper) or (positive and value <= 0):
            raise self.refusal(key, needed)
        return float(value)

    def integer(self, key: str, lower: int = 0, upper: int = 2**53) -> int:
        """A whole number within bounds."""
        value = self.data.get(key)
        if isinstance(value, bool) or not isinstance(value, int) or not lower <= value <= upper:
            raise self.refusal(key, f"a whole number in {lower}..{upper}")
        return value

    def item(self, key: str, find: Callable[[str], Item]) -> Item:
        """What a name stands for; an unknown one is the file's fault, not that of an argument."""
        try:
            return find(self.text(key))
        except UsageError as error:
            raise ModelFileError(f"{self.source}, {self.where(key)}: {error}") from error

    def truth(self, key: str) -> bool:
        """True or false."""
        value = self.data.get(key)
        if not isinstance(value, bool):
            raise self.refusal(key, "true or false")
        return value

    def text(self, key: str) -> str:
        """A string."""
        value = self.data.get(key)
        if not isinstance(value, str):
            raise self.refusal(key, "a text")
        return value

    def record(self, kind: type[Record], /, *, others: tuple[str, ...] = (), **given: object) -> Record:
        """The members as a dataclass, by its fields: see the head of this file.

        What is absent is as usual, where that is finite. Some members may be ``given``, and ``others`` are no fields.
        """
        self.refuse_others((*others, *_keys(kind)))
        return self._flat(kind, given)

    def _flat(self, kind: type[Record], given: Mapping[str, object]) -> Record:
        """A record beside whose members others may stand."""
        hints, values = _hints(kind), dict(given)
        for f in fields(kind):
            hint, limits, key = hints[f.name], f.metadata, f.metadata.get("key", f.name)
            if f.name in given or key is None:
                continue
            if limits.get("flat"):
                found = self._flat(limits.get("form", hint), limits.get("given", {}))
                values[f.name] = found.value if "form" in limits else found
                continue
            usual = f.default if f.default_factory is MISSING else f.default_factory()
            usual = None if usual is MISSING and type(None) in get_args(hint) else usual
            needed = limits.get("required") or usual is MISSING or usual in (inf, -inf)
            if not needed and self._empty(key, hint):
                values[f.name] = usual
            else:
                values[f.name] = self.member(key, hint, kind, dict(limits), SimpleNamespace(**values))
        result = kind(**values)
        for key, needed in getattr(result, "faults", tuple)():
            raise self.refusal(key, needed)
        return result

    def _empty(self, key: str, hint: Any) -> bool:
        """Whether a member is absent, null, or an empty list of what may be none."""
        if key not in self.data or hint in _PLAIN or get_origin(hint) is Literal:
            return key not in self.data
        return self.data[key] is None or (self.data[key] == [] and get_origin(_alternatives(hint)[0]) is tuple)

    def member(self, key: str, hint: Any, kind: Any, limits: dict[str, Any], values: SimpleNamespace) -> object:
        """A member of a type, of a record of a kind, beside the values of the fields before it."""
        of = _alternatives(hint)[0]
        origin, kinds = get_origin(of), limits.get("kinds") or _records(hint)
        result: object
        if origin is tuple:
            result = self._members(key, get_args(of), limits, values)
        elif kinds:
            result = self.section(key).one_of(kinds)
        elif origin is np.ndarray:
            result = self._numbers(key, kind, limits, values)
        elif origin is Mapping:
            result = self._mapping(key, get_args(of)[1], limits, values)
        elif of is int:
            result = self.integer(key, *limits.get("within", ()))
        elif of is float:
            result = self._limited(key, limits, values)
        elif of is bool:
            result = self.truth(key)
        else:
            result = self._text_of(key, get_args(of), limits)
        return result

    def _limited(self, key: str, limits: Mapping[str, Any], values: SimpleNamespace) -> float:
        bounds = {name: limits[name] for name in ("lower", "upper", "positive") if name in limits}
        if "not_below" in limits:
            bounds["lower"] = getattr(values, limits["not_below"])
        least = getattr(values, limits.get("above", ""), None)
        if least is not None and self.number(key) <= least:
            raise self.refusal(key, f"a finite number above {least:g}")
        return self.number(key, **bounds)

    def _text_of(self, key: str, allowed: tuple[str, ...], limits: Mapping[str, Any]) -> str:
        if allowed and self.text(key) not in allowed:
            raise self.refusal(key, " or ".join(allowed))
        return str(self.item(key, limits["item"]).name) if "item" in limits else self.text(key)

    def one_of(self, kinds: tuple[Any, ...]) -> object:
        """The record of the class that ``kind`` names, or else of the first that has a key here of its own."""
        tags = {_tag(kind): kind for kind in kinds if _tag(kind)}
        if len(kinds) > 1 and tags:
            if self.text("kind") not in tags:
                *names, last = tags
                raise self.refusal("kind", f"{', '.join(names)} or {last}")
            return self.record(tags[self.text("kind")])
        for kind in kinds[:-1]:
            if set(_keys(kind)).difference(*(_keys(other) for other in kinds if other is not kind)) & set(self.data):
                return self.record(kind)
        return self.record(kinds[-1])

    def _numbers(self, key: str, kind: Any, limits: Mapping[str, Any], values: SimpleNamespace) -> FloatArray:
        """An array, or clamped knots."""
        if "shape" in limits:
            return self.shaped(key, limits["shape"](values))
        found = self.array(key, *limits.get("dimensions", (1,)))
        if "degree" in limits:
            f: Field[Any] = kind.__dataclass_fields__[limits["degree"]]
            degree = self.integer(f.metadata.get("key", f.name), *f.metadata["within"])
            if not is_clamped(found, degree):
                raise self.refusal(key, f"ascending, with {degree + 1} equal knots at both ends and fewer inside")
        return found

    def _mapping(self, key: str, hint: Any, limits: Mapping[str, Any], values: SimpleNamespace) -> dict[str, Any]:
        found = self.section(key)
        names = limits["keys"](values) if "keys" in limits else tuple(found.data)
        found.refuse_others(limits.get("among", names))
        return {name: found.data[name] if hint is Any else found.member(name, hint, None, {}, values) for name in names}

    def _members(self, key: str, hints: tuple[Any, ...], limits: Mapping[str, Any], values: SimpleNamespace) -> object:
        """A tuple: of numbers, pairs of numbers, texts, or records."""
        if kinds := limits.get("kinds") or _records(hints[0]):
            found = self.sections(key, limits.get("least", 1))
            return tuple(section.one_of(kinds) for section in found)
        if hints[0] is str:
            return self.names(key, limits.get("least", 0))
        if limits.get("open"):
            return self._open_pair(key)
        pairs = hints[0] is not float
        array, count = self.array(key, 2 if pairs else 1), 2 if pairs else len(hints) if ... not in hints else None
        if count is not None and array.shape[-1] != count:
            raise self.refusal(key, "pairs of numbers" if pairs else f"{count} numbers")
        like = limits.get("like")
        if like is not None and len(array) != len(getattr(values, like)):
            raise self.refusal(key, f"{len(getattr(values, like))} numbers, one for each of {like}")
        rises = array[1:] - array[:-1]
        if limits.get("ascending") and (len(array) < 2 or not (rises > 0.0).all()):
            raise self.refusal(key, "two or more numbers in ascending order")
        if limits.get("monotone") and not (rises * rises[0] > 0.0).all():
            raise self.refusal(key, "rising or falling throughout")
        return tuple(map(tuple, array.tolist())) if pairs else tuple(array.tolist())

    def _open_pair(self, key: str) -> tuple[float, float]:
        bounds = self.data.get(key)
        if not isinstance(bounds, list) or len(bounds) != 2:
            raise self.refusal(key, "a pair, with null for a bound that is none")
        ends = Section(self.source, self.where(key), dict(zip(("lower", "upper"), bounds, strict=True)))
        lower, upper = (None if bound is None else ends.number(name) for name, bound in ends.data.items())
        return -inf if lower is None else lower, inf if upper is None else upper

    def section(self, key: str) -> "Section":
        """A nested object."""
        value = self.data.get(key)
        if not isinstance(value, Mapping):
            raise self.refusal(key, "an object")
        return Section(self.source, self.where(key), value)

    def sections(self, key: str, least: int = 1) -> tuple["Section", ...]:
        """A list of objects, so many at least."""
        value = self.data.get(key)
        if not isinstance(value, list) or len(value) < least or not all(isinstance(item, Mapping) for item in value):
            few = {0: "", 1: ", at least one"}.get(least, f", at least {least}")
            raise self.refusal(key, f"a list of objects{few}")
        return tuple(Section(self.source, f"{self.where(key)}[{k}]", item) for k, item in enumerate(value))

    def names(self, key: str, least: int = 0) -> tuple[str, ...]:
        """Texts in a list, so many at least."""
        names = self.data.get(key)
        if not isinstance(names, list) or len(names) < least or not all(isinstance(name, str) for name in names):
            raise self.refusal(key, f"a list of {f'{least} or more ' * (least > 0)}names")
        return tuple(names)

    def pair(self, key: str) -> tuple[float, float]:
        """Two finite numbers."""
        low, high = self.shaped(key, (2,)).tolist()
        return low, high

    def shaped(self, key: str, shape: tuple[int, ...]) -> FloatArray:
        """An array of a shape that other entries ask for."""
        if 0 in shape:
            return np.zeros(shape)
        found = self.array(key, len(shape))
        if found.shape != shape:
            numbers = " lists of ".join(map(str, shape))
            raise self.refusal(key, f"{numbers} numbers, as the knots and names beside it ask for")
        return found

    def array(self, key: str, *dimensions: int) -> FloatArray:
        """Finite numbers in nested lists of equal lengths, of one of some numbers of dimensions."""
        shape = " or ".join(counted(one, "dimension") for one in dimensions)
        needed = f"an array of finite numbers (below {_LARGEST:g}) with {shape}"
        value = self.data.get(key)
        if not isinstance(value, list):
            raise self.refusal(key, needed)
        try:
            result = np.array(value)
        except ValueError as error:  # lists of unequal lengths
            raise self.refusal(key, needed) from error
        if result.size and result.dtype.kind not in "if":
            raise self.refusal(key, needed)
        result = result.astype(np.float64)
        if result.ndim not in dimensions or not np.all(np.abs(result) < _LARGEST):
            raise self.refusal(key, needed)
        return result


def written(value: Any, *, tagged: bool = False) -> Any:
    """A record as JSON has it, by its fields; ``tagged`` with its kind."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: written(one) for key, one in value.items()}
    if isinstance(value, tuple | list):
        return [written(one, tagged=tagged) for one in value]
    return dict(_written_members(value, tagged)) if is_dataclass(value) else value


def _written_members(record: Any, tagged: bool) -> Iterator[tuple[str, Any]]:
    sparse, kind = isinstance(record, _SPARSE), record.__class__
    for f in fields(record):
        value, limits, key = getattr(record, f.name), f.metadata, f.metadata.get("key", f.name)
        usual = f.default if f.default_factory is MISSING else f.default_factory()
        spared = limits.get("omit") or (sparse and f.name not in _ALWAYS)
        as_usual = value is usual or (not isinstance(value, np.ndarray) and value == usual)
        if key is None or (f.name == "kind" and _tag(kind) and not tagged) or (spared and as_usual):
            continue
        if "form" in limits:
            many = isinstance(value, tuple)
            value = [limits["form"].of(one) for one in value] if many else limits["form"].of(value)
        if limits.get("open"):
            value = [None if isinf(bound) else bound for bound in value]
        if limits.get("flat"):
            yield from _written_members(value, tagged=False)
        else:
            yield key, written(value, tagged="kinds" in limits)


@cache
def _hints(kind: Any) -> dict[str, Any]:
    return get_type_hints(kind)


def _alternatives(hint: Any) -> tuple[Any, ...]:
    """The types that a hint allows, none of them None."""
    return tuple(one for one in (get_args(hint) if isinstance(hint, UnionType) else (hint,)) if one is not type(None))


def _records(hint: Any) -> tuple[Any, ...]:
    """The dataclasses that a hint allows."""
    return tuple(filter(is_dataclass, _alternatives(hint)))


@cache
def _tag(kind: Any) -> str:
    """The ``kind`` by which a file tells a class from others; empty where it has none."""
    names = get_args(_hints(kind).get("kind"))
    return str(names[0]) if len(names) == 1 else ""


@cache
def _keys(kind: Any) -> tuple[str, ...]:
    """The members that a record has in a file."""
    keys: list[str] = []
    for f in fields(kind):
        key, of = f.metadata.get("key", f.name), f.metadata.get("form", _hints(kind)[f.name])
        keys += _keys(of) if f.metadata.get("flat") else [key] if key is not None else []
    return tuple(keys)


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
