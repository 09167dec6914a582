"""Values of a JSON object, each checked where it is read and named by its key path in every message."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, TypeVar, get_type_hints

import numpy as np

from femfit.core.errors import ModelFileError, UsageError
from femfit.core.numerics import FloatArray
from femfit.core.text import counted

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Item = TypeVar("Item")
Record = TypeVar("Record", bound="DataclassInstance")

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

    def number(self, key: str, *, lower: float = -np.inf, positive: bool = False, absent: float | None = None) -> float:
        """A finite number of at least ``lower``, or > 0 where ``positive``; ``absent`` in files of older versions."""
        value = self.data.get(key) if key in self.data else absent
        needed = "a finite number" + (" > 0" if positive else f" >= {lower:g}" if np.isfinite(lower) else "")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.refusal(key, needed)
        if abs(value) >= _LARGEST:
            needed += f", of less than {_LARGEST:g}"
        if positive and 0 < value < _SMALLEST:
            raise self.refusal(key, f"{needed}, of at least {_SMALLEST:g}")
        if not abs(value) < _LARGEST or value < lower or (positive and value <= 0):
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

    def record(self, kind: type[Record], /, **given: object) -> Record:
        """The members as a dataclass, by the types of its fields and the limits in their metadata.

        ``positive``, ``lower`` and ``within`` limit a number, ``absent`` stands for one that is not there, and
        ``not_below`` names the field that it must reach; members that are not plain numbers, texts or truths are
        ``given``.
        """
        self.refuse_others(tuple(f.name for f in fields(kind)))
        hints = get_type_hints(kind)
        values = dict(given)
        for f in fields(kind):
            if f.name not in given:
                limits = dict(f.metadata)
                if "not_below" in limits:
                    limits["lower"] = values[limits.pop("not_below")]
                values[f.name] = self._member(f.name, hints[f.name], limits)
        return kind(**values)

    def _member(self, key: str, hint: object, limits: Mapping[str, Any]) -> object:
        if hint is int:
            return self.integer(key, *limits.get("within", (0, 2**53)))
        plain = {str: self.text, bool: self.truth}.get(hint)  # type: ignore[call-overload]
        if plain is not None:
            return plain(key)
        return self.number(key, **limits) if hint is float else self.optional_number(key, **limits)

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


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
