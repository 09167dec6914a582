"""Records of a model file, read and written by the fields of their dataclasses; a fault is named by its key path.

The metadata of a field are

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
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from math import inf, isinf
from types import SimpleNamespace, UnionType
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from pydantic_core import CoreSchema, PydanticCustomError, SchemaValidator, ValidationError
from pydantic_core import core_schema as schemas

from femfit.core.errors import ModelFileError, UsageError
from femfit.core.numerics import FloatArray
from femfit.core.text import counted
from femfit.device.electrics import Circuit, Drive, Sensor
from femfit.device.mechanics import ForceTable, Mechanics, Spring, Stop
from femfit.model.bspline import is_clamped

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Record = TypeVar("Record", bound="DataclassInstance")

_PLAIN = (float, int, bool, str)

_LARGEST = 1e60
"""Derived: products of five such numbers are finite. No quantity of an actuator comes near it."""

_SMALLEST = 1 / _LARGEST
"""Derived: one over it is still such a number, and what must be > 0 is divided by."""

_SPARSE = Mechanics, Spring, ForceTable, Stop, Circuit, Drive, Sensor
"""Of these a file has what is not as usual, and what is in :data:`_ALWAYS`."""

_ALWAYS = ("mass_kg", "gravity_m_s2", "kind", "unit")


def read_record(kind: type[Record], data: object, source: str) -> Record:
    """A record from JSON; a field with a ``form`` that is not flat holds that form.

    Raises
    ------
    ModelFileError
        If a member is missing, unknown or not what is needed.
    """
    try:
        record: Record = _reader(kind).validate_python(data)
    except ValidationError as error:
        errors = error.errors(include_url=False)
        first = min(errors, key=lambda each: each["type"] != "extra_forbidden")  # a misspelt key is missing, too
        key = first.get("ctx", {}).get("key", "")
        places = (f"[{each}]" if isinstance(each, int) else f".{each}" for each in first["loc"])
        path = f"{''.join(places)}{key and '.'}{key}".removeprefix(".")
        if first["type"] == "extra_forbidden":
            text = f"{source} has the unknown key {path}. Correct its spelling, or update femfit."
            raise ModelFileError(text) from error
        if first["type"] == "missing":
            raise ModelFileError(f"{source} is damaged: {path} is missing. Write it again with femfit fit.") from error
        needed = "an object" if first["type"] == "dict_type" else first["msg"]
        raise refusal(source, path, needed, member_at(first["input"], key)) from error
    return record


def refusal(source: str, path: str, needed: str, value: object = MISSING) -> ModelFileError:
    """The error for a member that is not what is needed."""
    text = repr(value)
    given = "it is missing" if value is MISSING else f"instead received {text[:57]}{'...' * (len(text) > 57)}"
    return ModelFileError(f"{source} is damaged: {path} must be {needed}; {given}. Write it again with femfit fit.")


def member_at(data: Any, path: str) -> Any:
    """What stands at a key path such as ``a[0].b``."""
    for step in re.findall(r"[^.\[\]]+", path):
        data = data[int(step)] if isinstance(data, list) else data.get(step, MISSING)
    return data


def _fault(needed: str, key: str = "") -> PydanticCustomError:
    return PydanticCustomError("needed", "{needed}", {"needed": needed, "key": key})


@cache
def _reader(kind: Any) -> SchemaValidator:
    members = schemas.typed_dict_schema(_members(kind), extra_behavior="forbid")
    return SchemaValidator(schemas.no_info_after_validator_function(lambda found: _built(kind, found), members))


def _members(kind: Any) -> dict[str, schemas.TypedDictField]:
    """What may and must stand in an object, by key."""
    members: dict[str, schemas.TypedDictField] = {}
    for f in fields(kind):
        hint, limits, key = _hints(kind)[f.name], f.metadata, _key(f)
        if limits.get("flat"):
            own = _members(limits.get("form", hint))
            members |= {name: own[name] for name in own if name not in limits.get("given", ())}
        elif key is not None:
            usual = _usual(f, hint)
            needed = limits.get("required", False) or usual is MISSING or usual in (inf, -inf)
            schema = _schema(hint, limits, int(needed))
            if not (needed or hint in _PLAIN or get_origin(hint) is Literal) or type(None) in get_args(hint):
                schema = schemas.nullable_schema(schema)
            members[key] = schemas.typed_dict_field(schema, required=needed)
    return members


def _built(kind: Any, members: Mapping[str, Any], given: Mapping[str, Any] | None = None) -> Any:
    """A record of its members, beside which others may stand."""
    values = dict(given or {})
    for f in fields(kind):
        hint, limits, key = _hints(kind)[f.name], f.metadata, _key(f)
        if f.name in values or key is None:
            continue
        if limits.get("flat"):
            inner = _built(limits.get("form", hint), members, limits.get("given"))
            values[f.name] = inner.value if "form" in limits else inner
        elif members.get(key) is None:
            usual = _usual(f, hint)
            values[f.name] = None if usual is MISSING else usual
        else:
            degree = kind.__dataclass_fields__.get(limits.get("degree"))
            if degree is not None and not is_clamped(members[key], members[_key(degree) or ""]):
                more = members[_key(degree) or ""] + 1
                raise _fault(f"ascending, with {more} equal knots at both ends and fewer inside", key)
            values[f.name] = _beside(members[key], key, limits, SimpleNamespace(**values))
    record = kind(**values)
    for key, needed in getattr(record, "faults", tuple)():
        raise _fault(needed, key)
    return record


def _beside(value: Any, key: str, limits: Mapping[str, Any], before: SimpleNamespace) -> Any:
    """A member that goes with those before it."""
    if (least := getattr(before, limits.get("not_below", ""), None)) is not None and value < least:
        raise _fault(f"a finite number >= {least:g}", key)
    if (least := getattr(before, limits.get("above", ""), None)) is not None and value <= least:
        raise _fault(f"a finite number above {least:g}", key)
    if (like := getattr(before, limits.get("like", ""), None)) is not None and len(value) != len(like):
        raise _fault(f"{len(like)} numbers, one for each of {limits['like']}", key)
    shape = limits["shape"](before) if "shape" in limits else ()
    if 0 in shape:
        return np.zeros(shape)
    if shape and value.shape != shape:
        numbers = " lists of ".join(map(str, shape))
        raise _fault(f"{numbers} numbers, as the knots and names beside it ask for", key)
    names = limits["keys"](before) if "keys" in limits else value
    if "keys" in limits and set(value) != set(names):
        raise _fault(f"an object with the keys {', '.join(names)}" if names else "an empty object", key)
    return value


def _schema(hint: Any, limits: Mapping[str, Any], least: int = 0) -> CoreSchema:
    """What checks a member of a type; what is a list has so many items at least."""
    of = _alternatives(hint)[0]
    origin, inner, form = get_origin(of), get_args(of), limits.get("form")
    several = origin is tuple
    kinds = limits.get("kinds") or tuple(
        filter(is_dataclass, (form,) if form else _alternatives(inner[0] if several else hint))
    )
    if several:
        return _list(inner, kinds, limits, limits.get("least", least))
    if kinds:
        return _one_of(kinds)
    if origin is np.ndarray:
        axes = range(1, 9) if "shape" in limits else limits.get("dimensions", (1,))
        return schemas.no_info_plain_validator_function(lambda value: _array(value, *axes))
    if origin is Mapping:
        names = schemas.literal_schema([*limits["among"]]) if "among" in limits else schemas.str_schema()
        return schemas.dict_schema(names, schemas.any_schema() if inner[1] is Any else _schema(inner[1], {}))
    return _plain(of, inner, limits)


def _list(hints: tuple[Any, ...], kinds: tuple[Any, ...], limits: Mapping[str, Any], least: int) -> CoreSchema:
    """What checks a list: of records, texts, numbers, or pairs of numbers."""
    few = f", at least {least}" if least else ""
    if kinds:
        items = schemas.list_schema(schemas.dict_schema(), min_length=least, strict=True)
        listed = _told(items, f"a list of objects{few}")
        return schemas.chain_schema([listed, schemas.tuple_variable_schema(_one_of(kinds))])
    if hints[0] is str:
        names = schemas.list_schema(schemas.str_schema(strict=True), min_length=limits.get("least", 0), strict=True)
        return _after(_told(names, f"a list of names{few}"), tuple)
    if limits.get("open"):
        end: CoreSchema = schemas.nullable_schema(_schema(float, {}))
        ends = schemas.tuple_positional_schema([end, end])
        bounds = _told(ends, "a pair, with null for a bound that is none")
        return _after(bounds, lambda pair: tuple(e if x is None else x for x, e in zip(pair, (-inf, inf), strict=True)))
    return schemas.no_info_plain_validator_function(
        lambda value: () if value == [] and not least else _tuple(value, hints, limits)
    )


def _plain(of: Any, allowed: tuple[Any, ...], limits: Mapping[str, Any]) -> CoreSchema:
    """What checks a number, a text or a truth value."""
    if of is float:
        low, high, positive = limits.get("lower", -inf), limits.get("upper", inf), limits.get("positive")
        needed = "a finite number" + (" > 0" if positive else f" >= {low:g}" if low > -inf else "")
        needed = needed if high == inf else f"a finite number of {low:g} to {high:g}"
        low, high = max(low, _SMALLEST if positive else -_LARGEST), min(high, _LARGEST)
        return _told(schemas.float_schema(strict=True, allow_inf_nan=False, ge=low, le=high), needed)
    if of is int:
        least, most = limits.get("within", (0, 2**53))
        return _told(schemas.int_schema(strict=True, ge=least, le=most), f"a whole number in {least}..{most}")
    if of is bool:
        return _told(schemas.bool_schema(strict=True), "true or false")
    if allowed:
        return _told(schemas.literal_schema([*allowed]), " or ".join(allowed))

    def named(text: str) -> str:
        try:
            return str(limits["item"](text).name)
        except UsageError as error:
            raise _fault(f"a name that there is ({error})") from error

    text = _told(schemas.str_schema(strict=True), "a text")
    return _after(text, named) if "item" in limits else text


def _one_of(kinds: tuple[Any, ...]) -> CoreSchema:
    """The record of the class that ``kind`` names, or else of the first that has a key there of its own."""
    tags = {_tag(kind): kind for kind in kinds if _tag(kind)} if len(kinds) > 1 else {}
    own = {
        kind: set(_members(kind)).difference(*(_members(each) for each in kinds if each is not kind)) for kind in kinds
    }

    def read(value: object) -> object:
        if not isinstance(value, Mapping):
            raise _fault("an object")
        if tags and value.get("kind") not in list(tags):
            *names, last = tags
            raise _fault(f"{', '.join(names)} or {last}", "kind")
        kind = tags[value["kind"]] if tags else next((each for each in kinds if own[each] & set(value)), kinds[-1])
        return _reader(kind).validate_python(value)

    return schemas.no_info_plain_validator_function(read)


def _told(schema: CoreSchema, needed: str) -> CoreSchema:
    """The same check, of which every fault says what is needed."""
    return schemas.custom_error_schema(schema, "needed", custom_error_message=needed)


def _after(schema: CoreSchema, function: Callable[[Any], Any]) -> CoreSchema:
    return schemas.no_info_after_validator_function(function, schema)


def _tuple(value: object, hints: tuple[Any, ...], limits: Mapping[str, Any]) -> tuple[Any, ...]:
    """Numbers, or pairs of them."""
    pairs = hints[0] is not float
    array, count = _array(value, 2 if pairs else 1), 2 if pairs else len(hints) if ... not in hints else None
    if count is not None and array.shape[-1] != count:
        raise _fault("pairs of numbers" if pairs else f"{count} numbers")
    rises = array[1:] - array[:-1]
    if limits.get("ascending") and (len(array) < 2 or not (rises > 0.0).all()):
        raise _fault("two or more numbers in ascending order")
    if limits.get("monotone") and not (rises * rises[0] > 0.0).all():
        raise _fault("rising or falling throughout")
    return tuple(map(tuple, array.tolist())) if pairs else tuple(array.tolist())


def _array(value: object, *dimensions: int) -> FloatArray:
    """Finite numbers in nested lists of equal lengths, of one of some numbers of dimensions."""
    shape = f" with {' or '.join(counted(n, 'dimension') for n in dimensions)}" if len(dimensions) < 3 else ""
    needed = f"an array of finite numbers (below {_LARGEST:g}){shape}"
    if not isinstance(value, list):
        raise _fault(needed)
    try:
        result = np.array(value)
    except ValueError as error:  # lists of unequal lengths
        raise _fault(needed) from error
    if result.size and result.dtype.kind not in "if":
        raise _fault(needed)
    result = result.astype(np.float64)
    if result.ndim not in dimensions or not np.all(np.abs(result) < _LARGEST):
        raise _fault(needed)
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


def _key(f: Field[Any]) -> str | None:
    """The name of a field's member; None where there is none."""
    key: str | None = f.metadata.get("key", f.name)
    return key


def _usual(f: Field[Any], hint: Any) -> Any:
    """What stands for a member that is not there."""
    usual = f.default if f.default_factory is MISSING else f.default_factory()
    return None if usual is MISSING and type(None) in get_args(hint) else usual


@cache
def _hints(kind: Any) -> dict[str, Any]:
    return get_type_hints(kind)


def _alternatives(hint: Any) -> tuple[Any, ...]:
    """The types that a hint allows, none of them None."""
    return tuple(one for one in (get_args(hint) if isinstance(hint, UnionType) else (hint,)) if one is not type(None))


@cache
def _tag(kind: Any) -> str:
    """The ``kind`` by which a file tells a class from others; empty where it has none."""
    names = get_args(_hints(kind).get("kind"))
    return str(names[0]) if len(names) == 1 else ""
