"""What femfit has built in and what other packages add to it by entry points, looked up by name."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import Generic, Protocol, TypeVar

from femfit.core.errors import ModelFileError, UsageError


class Named(Protocol):
    """What can stand in a catalogue."""

    @property
    def name(self) -> str:
        """As typed by users and written to model files."""


Item = TypeVar("Item", bound=Named)


@dataclass(frozen=True)
class EntryCatalogue(Generic[Item]):
    """Built-in items, and how those of other packages are checked."""

    kind: type[Item]
    title: str
    built_in: Sequence[Item]
    unlisted: Sequence[Item] = ()

    def all(self, entries: Iterable[EntryPoint]) -> dict[str, Item]:
        """Every item by its name: those of femfit, then those of installed packages.

        Returns
        -------
        dict
            In the catalogue's order; a name of femfit's own cannot be taken by another package.
        """
        items = {item.name: item for item in self.built_in}
        for entry in entries:
            items.setdefault(entry.name, self._loaded(entry))
        return items

    def find(self, name: str, entries: Callable[[], Iterable[EntryPoint]]) -> Item:
        """Look up an item; only the package that gives it is loaded.

        ``entries`` gives those of the catalogue's group; it is called only for a name that is not built in.

        Raises
        ------
        UsageError
            If there is no item of that name.
        ModelFileError
            If its package cannot be loaded.
        """
        for item in (*self.built_in, *self.unlisted):
            if item.name == name:
                return item
        extensions = list(entries())
        for entry in extensions:
            if entry.name == name:
                return self._loaded(entry)
        names = [item.name for item in self.built_in] + [entry.name for entry in extensions]
        raise UsageError(
            f"{self.title} must be one of {', '.join(names)}; instead received {name!r}. If another package gives it, "
            "install that package."
        )

    def _loaded(self, entry: EntryPoint) -> Item:
        try:
            item = entry.load()
        except (ImportError, AttributeError) as error:
            raise ModelFileError(
                f"{self.title} {entry.name!r} ({entry.value}) cannot be loaded: {error}. Repair or remove its package."
            ) from error
        if not isinstance(item, self.kind) or item.name != entry.name:
            article = "an" if self.kind.__name__[0] in "AEIOU" else "a"
            raise ModelFileError(
                f"Entry point {entry.name!r} ({entry.value}) must give {article} {self.kind.__name__} of that name; it "
                "does not. Repair or remove its package."
            )
        return item
