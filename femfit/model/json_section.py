"""Values of a JSON object, each checked where it is read and named by its key path in every message."""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from types import UnionType
from typing import TYPE_CHECKING, Any, Literal, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np

from femfit.core.errors import ModelFileError, UsageError
from femfit.core.numerics import FloatArray
from femfit.core.text import counted

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Item = TypeVar("Item")
Record = TypeVar("Record", bound="DataclassInstance")

_PLAIN = (float, int, bool, str)

_LARGEST = 1e60
"""Derived: products of five such numbers are finite. No quantity of an actuator comes near it."""

_SMALLEST = 1 / _LARGEST
"""Derived: one over it is still such a number, and what must be > 0 is divided by."""


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
        """The error for a member that is missing or not what is needed."""
        given = f"instead received {_short(self.data[key])}" if key in self.data else "it is missing"
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

    def number(
        self,
        key: str,
        *,
        lower: float = -np.inf,
        upper: float = np.inf,
        positive: bool = False,
        absent: float | None = None,
    ) -> float:
        """A finite number within limits, or > 0 where ``positive``; ``absent`` in files of older versions."""
        value = self.data.get(key) if key in self.data else absent
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

    def optional_number(self, key: str, *, lower: float = -np.inf, positive: bool = False) -> float | None:
        """A number as of :meth:`number`, or None where the member is null or absent."""
        return None if self.data.get(key) is None else self.number(key, lower=lower, positive=positive)

    def integer(self, key: str, lower: int, upper: int) -> int:
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
        """The members as a dataclass, by the types of its fields and the limits in their metadata.

        ``positive``, ``lower``, ``upper`` and ``within`` limit a number; ``not_below`` and ``above`` name the field
        that it must reach or exceed; numbers in a list may be ``ascending`` or ``monotone``, and as many as those of
        the field in ``like``. What is absent is as usual, where that is finite. Members of other types are ``given``,
        and ``others`` are no fields.
        """
        self.refuse_others((*others, *(f.name for f in fields(kind))))
        hints, values = get_type_hints(kind), dict(given)
        for f in fields(kind):
            hint, value, usual = hints[f.name], self.data.get(f.name), f.default
            if usual is MISSING and type(None) in get_args(hint):
                usual = None
            empty = f.name not in self.data or (hint not in _PLAIN and not value and value != 0)
            if f.name not in given:
                taken = empty and (usual is None or usual not in {MISSING, np.inf, -np.inf})
                values[f.name] = usual if taken else self._member(f.name, hint, dict(f.metadata), values)
        return kind(**values)

    def _member(self, key: str, hint: Any, limits: dict[str, Any], values: Mapping[str, Any]) -> object:
        kinds = [one for one in get_args(hint) if one is not type(None)] if isinstance(hint, UnionType) else [hint]
        if get_origin(hint) is Literal:
            if self.text(key) not in get_args(hint):
                raise self.refusal(key, " or ".join(get_args(hint)))
            return self.text(key)
        if is_dataclass(kinds[0]):
            return self.section(key).record(cast("Any", kinds[0]))
        if get_origin(kinds[0]) is tuple:
            return self._members(key, get_args(kinds[0]), limits, values)
        if kinds[0] is int:
            return self.integer(key, *limits.get("within", (0, 2**53)))
        if kinds[0] is float:
            if "not_below" in limits:
                limits["lower"] = values[limits.pop("not_below")]
            least = values.get(limits.pop("above", ""))
            if least is not None and self.number(key) <= least:
                raise self.refusal(key, f"a finite number above {least:g}")
            return self.number(key, **limits)
        return self.truth(key) if kinds[0] is bool else self.text(key)

    def _members(self, key: str, hints: tuple[Any, ...], limits: dict[str, Any], values: Mapping[str, Any]) -> object:
        """A tuple: of numbers, pairs of numbers, texts, or records of which each has the first field of its class."""
        of = get_args(hints[0]) if isinstance(hints[0], UnionType) else hints[:1]
        if is_dataclass(of[0]):
            kinds = {fields(kind)[0].name: kind for kind in of}
            found = [
                next((kind for name, kind in kinds.items() if name in one.data), of[-1]) for one in self.sections(key)
            ]
            return tuple(one.record(kind) for one, kind in zip(self.sections(key), found, strict=True))
        if hints[0] is str:
            return self.names(key)
        pairs = hints[0] is not float
        array, count = self.array(key, 2 if pairs else 1), 2 if pairs else len(hints) if ... not in hints else None
        if count is not None and array.shape[-1] != count:
            raise self.refusal(key, "pairs of numbers" if pairs else f"{count} numbers")
        like = limits.get("like")
        if like is not None and len(array) != len(values[like]):
            raise self.refusal(key, f"{len(values[like])} numbers, one for each of {like}")
        rises = array[1:] - array[:-1]
        if limits.get("ascending") and (len(array) < 2 or not (rises > 0.0).all()):
            raise self.refusal(key, "two or more numbers in ascending order")
        if limits.get("monotone") and not (rises * rises[0] > 0.0).all():
            raise self.refusal(key, "rising or falling throughout")
        return tuple(map(tuple, array.tolist())) if pairs else tuple(array.tolist())

    def section(self, key: str) -> "Section":
        """A nested object."""
        value = self.data.get(key)
        if not isinstance(value, Mapping):
            raise self.refusal(key, "an object")
        return Section(self.source, self.where(key), value)

    def optional_section(self, key: str) -> "Section | None":
        """A nested object, or None where the member is null or absent."""
        return None if self.data.get(key) is None else self.section(key)

    def sections(self, key: str) -> tuple["Section", ...]:
        """A list of one or more objects."""
        value = self.data.get(key)
        if not isinstance(value, list) or not value or not all(isinstance(item, Mapping) for item in value):
            raise self.refusal(key, "a list of objects, at least one")
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


def plain(value: object, record: Callable[[Any], Any] = vars) -> Any:
    """What JSON has as it is: dataclasses as mappings of their fields or as ``record`` has them, arrays as lists."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: plain(one, record) for key, one in value.items()}
    if isinstance(value, tuple | list):
        return [plain(one, record) for one in value]
    return plain(record(value), record) if is_dataclass(value) and not isinstance(value, type) else value


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
