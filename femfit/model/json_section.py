"""Records of a model file, read and written by the fields of their dataclasses; a fault is named by its key path.

The metadata of a field are

============================  ========================================================================================
``key``                       the member's name where it is not the field's; None of a field that no file has
``flat``                      the members of this record stand beside the others
``form``                      the record that stands for it in a file, with ``of``, and where it is flat ``value``
``kinds``                     the classes of which it is one, told by their ``kind`` or by a key of their own
``omit``, ``always``          not written where it is as usual, as of a record of the drawing; written all the same
``required``                  never absent though there is a default
``positive``, ``lower`` ...   limits of a number, with ``upper`` and ``within``
``least``                     least length of a list
``degree``                    of clamped knots, the field that has their degree
``shape``, ``dimensions``     of an array: what the members before it ask for, or how many axes it may have
============================  ========================================================================================

A record that has ``faults`` is asked for them: keys, each with what stands there in place of what is needed.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from math import inf
from types import SimpleNamespace, UnionType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from femfit.core.errors import ModelFileError
from femfit.core.files import finite_number
from femfit.core.numerics import FloatArray
from femfit.core.results import json_ready
from femfit.device.complaints import joined
from femfit.device.electrics import Circuit
from femfit.device.keys import Record, kind_of
from femfit.model.bspline import is_clamped

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Section = TypeVar("Section", bound="DataclassInstance")

_LARGEST = 1e60
"""Derived: products of five such numbers are finite. No quantity of an actuator comes near it."""

_SMALLEST = 1 / _LARGEST
"""Derived: one over it is still such a number, and what must be > 0 is divided by."""


class _Fault(Exception):  # noqa: N818  read_record makes an error of it
    """Key path, what is needed there, and what stands there."""


def read_record(kind: type[Section], data: object, source: str) -> Section:
    """A record from JSON; a field with a ``form`` that is not flat holds that form.

    Raises
    ------
    ModelFileError
        If a member is missing, unknown or not what is needed.
    """
    try:
        record: Section = _one_of((kind,), data, "")
    except _Fault as fault:
        raise refusal(source, *fault.args) from None
    return record


def refusal(source: str, path: str, needed: str, value: object = MISSING) -> ModelFileError:
    """The error for a member that is not what is needed."""
    text = repr(value)
    instead = "it is missing" if value is MISSING else f"instead received {text[:57]}{'...' * (len(text) > 57)}"
    return ModelFileError(f"{source} is damaged: {path} must be {needed}; {instead}. Write it again with femfit fit.")


def member_at(data: Any, path: str) -> Any:
    """What stands at a key path such as ``a[0].b``."""
    for step in re.findall(r"[^.\[\]]+", path):
        data = data[int(step)] if isinstance(data, list) else data.get(step, MISSING)
    return data


@cache
def _keys(kind: Any) -> frozenset[str | None]:
    """What may stand in an object."""
    flat = (_keys(member.facts.get("form", member.hint)) for member in _members(kind) if member.facts.get("flat"))
    return frozenset().union(*flat, (member.key for member in _members(kind) if not member.facts.get("flat"))) - {None}


def _built(kind: Any, data: Mapping[str, Any], path: str) -> Any:
    """A record of an object's members, beside which others may stand."""
    values: dict[str, Any] = {}
    for name, key, hint, usual, limits in _members(kind):
        if key is None:
            continue
        if limits.get("flat"):
            inner = _built(limits.get("form", hint), data, path)
            values[name] = inner.value if "form" in limits else inner
            continue
        value, place, optional = data.get(key, MISSING), joined(path, key), type(None) in get_args(hint)
        needed = limits.get("required", False) or (usual is MISSING and not optional) or usual in (inf, -inf)
        if value is MISSING and needed:
            raise _Fault(place, "given")
        if value is MISSING or (value is None and (not needed or optional)):
            values[name] = None if usual is MISSING else usual
            continue
        values[name] = value = _member(hint, limits, value, place)
        degree = next((data.get(m.key) for m in _members(kind) if m.key and m.name == limits.get("degree")), None)
        if isinstance(degree, int) and not is_clamped(value, degree):
            raise _Fault(place, f"ascending, with {degree + 1} equal knots at both ends and fewer inside", data[key])
        shape = limits["shape"](SimpleNamespace(**values)) if "shape" in limits else ()
        if 0 in shape:
            values[name] = np.zeros(shape)
        elif shape and value.shape != shape:
            numbers = " lists of ".join(map(str, shape))
            raise _Fault(place, f"{numbers} numbers, as the knots and names beside it ask for", data[key])
    record = kind(**values)
    for key, needed in getattr(record, "faults", tuple)():
        raise _Fault(f"{path}.{key}".removeprefix("."), needed, member_at(data, key))
    return record


def _member(hint: Any, limits: Mapping[str, Any], value: Any, path: str) -> Any:
    """A member of a type."""
    of = _alternatives(hint)[0]
    origin, inner, form = get_origin(of), get_args(of), limits.get("form")
    kinds = tuple(filter(is_dataclass, (form,) if form else _alternatives(inner[0] if origin is tuple else hint)))
    kinds = limits.get("kinds") or kinds
    if origin is tuple:
        return tuple(_items(inner, kinds, limits.get("least", 0), value, path))
    if kinds:
        return _one_of(kinds, value, path)
    if origin is np.ndarray:
        return _array(value, path, range(1, 9) if "shape" in limits else limits.get("dimensions", (1,)))
    if origin is not Mapping:
        return _plain(of, limits, value, path)
    if not isinstance(value, Mapping):
        raise _Fault(path, "an object", value)
    if inner[1] is Any and value != json_ready(value):
        raise _Fault(path, "without numbers that are not finite", value)
    return {key: x if inner[1] is Any else _member(inner[1], {}, x, joined(path, key)) for key, x in value.items()}


def _items(hints: tuple[Any, ...], kinds: tuple[Any, ...], least: int, value: Any, path: str) -> Iterator[Any]:
    """The items of a list of any length, or of so many numbers; of a pair of these, null is a bound that is none."""
    fixed = ... not in hints
    if not isinstance(value, list) or len(value) < least or (fixed and len(value) != len(hints)):
        names = "objects" if kinds else "names" if hints[0] is str else "numbers"
        raise _Fault(path, f"{len(hints)} {names}" if fixed else f"a list of {names}", value)
    for k, entry in enumerate(value):
        if entry is None and hints == (float, float):
            yield (-inf, inf)[k]
        else:
            yield _one_of(kinds, entry, f"{path}[{k}]") if kinds else _member(hints[0], {}, entry, f"{path}[{k}]")


def _plain(of: Any, limits: Mapping[str, Any], value: Any, path: str) -> Any:
    """A number, a text or a truth value."""
    if of is float:
        low, high, positive = limits.get("lower", -inf), limits.get("upper", inf), limits.get("positive")
        needed = "a finite number" + (" > 0" if positive else f" >= {low:g}" if low > -inf else "")
        low, high, number = max(low, _SMALLEST if positive else -_LARGEST), min(high, _LARGEST), finite_number(value)
        if number is None or not low <= number <= high:
            raise _Fault(path, needed + f" and <= {high:g}" * (high < _LARGEST), value)
        return number
    if of is int:
        least, most = limits.get("within", (0, 2**53))
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            raise _Fault(path, f"a whole number in {least}..{most}", value)
    elif get_origin(of) is Literal:
        if value not in get_args(of):
            raise _Fault(path, " or ".join(get_args(of)), value)
    elif not isinstance(value, of):
        raise _Fault(path, "true or false" if of is bool else "a text", value)
    return value


def _one_of(kinds: tuple[Any, ...], value: Any, path: str) -> Any:
    """The record of the class that ``kind`` names, or else of the first that has a key there of its own, all known."""
    if not isinstance(value, Mapping):
        raise _Fault(path, "an object", value)
    tags = {kind_of(kind): kind for kind in kinds if kind_of(kind)} if len(kinds) > 1 else {}
    if tags and value.get("kind") not in list(tags):
        raise _Fault(joined(path, "kind"), " or ".join(tags), value.get("kind", MISSING))
    distinct = {kind: _keys(kind).difference(*(_keys(each) for each in kinds if each is not kind)) for kind in kinds}
    kind = next((each for each in kinds if distinct[each] & set(value)), kinds[-1])
    kind = tags[value["kind"]] if tags else kind
    for key in value:
        if key not in _keys(kind):
            raise _Fault(joined(path, key), "a key that there is: correct its spelling, or update femfit", value[key])
    return _built(kind, value, path)


def _array(value: Any, path: str, dimensions: Sequence[int]) -> FloatArray:
    """Finite numbers in nested lists of equal lengths, of one of some numbers of dimensions."""
    try:
        result = np.array(value if isinstance(value, list) else np.nan)
    except ValueError:  # of unequal lengths
        result = np.array(np.nan)
    result = result.astype(np.float64) if result.dtype.kind in "if" else np.array(np.nan)
    if result.ndim not in dimensions or not np.all(np.abs(result) < _LARGEST):
        raise _Fault(path, f"an array of finite numbers (below {_LARGEST:g})", value)
    return result


def written(value: Any, *, tagged: bool = False) -> Any:
    """A record as JSON has it, by its fields; ``tagged`` with its kind."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: written(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [written(item, tagged=tagged) for item in value]
    return dict(_written_members(value, tagged)) if is_dataclass(value) else value


def _written_members(record: Any, tagged: bool) -> Iterator[tuple[str, Any]]:
    kind: Any = type(record)
    for name, key, _, usual, limits in _members(kind):
        value = getattr(record, name)
        spared = limits.get("omit", isinstance(record, Record | Circuit) and name != "kind" and "always" not in limits)
        as_usual = value is usual or (not isinstance(value, np.ndarray) and value == usual)
        if key is None or (name == "kind" and kind_of(kind) and not tagged) or (spared and as_usual):
            continue
        if "form" in limits:
            many = isinstance(value, tuple)
            value = [limits["form"].of(item) for item in value] if many else limits["form"].of(value)
        if isinstance(value, tuple) and any(x in (inf, -inf) for x in value):
            value = [None if x in (inf, -inf) else x for x in value]
        if limits.get("flat"):
            yield from _written_members(value, tagged=False)
        else:
            yield key, written(value, tagged="kinds" in limits)


class _Member(NamedTuple):
    """What a field says of its member in a file."""

    name: str
    key: str | None  # None of a field that no file has
    hint: Any
    usual: Any
    facts: Mapping[str, Any]


@cache
def _members(kind: Any) -> tuple[_Member, ...]:
    """Those of a record's fields."""
    hints = get_type_hints(kind)
    usual = {f.name: f.default if f.default_factory is MISSING else f.default_factory() for f in fields(kind)}
    return tuple(
        _Member(f.name, f.metadata.get("key", f.name), hints[f.name], usual[f.name], f.metadata) for f in fields(kind)
    )


def _alternatives(hint: Any) -> tuple[Any, ...]:
    """The types that a hint allows, none of them None."""
    return tuple(t for t in (get_args(hint) if isinstance(hint, UnionType) else (hint,)) if t is not type(None))
