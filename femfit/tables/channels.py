"""The registry of channels: what a table may hold, read from ``channels.toml``, which says what each field means."""

import math
import tomllib
from dataclasses import dataclass
from importlib.resources import files


@dataclass(frozen=True)
class Channel:
    """A row of the registry."""

    names: tuple[str, ...] = ()
    noun: str = ""
    bench: str = ""  # setting, reading, or empty for what is no column of a bench table
    absent: float = math.nan
    record: int = 0
    sensor: bool = False
    usual: float = math.inf
    possible: float = math.inf
    units: tuple[str, ...] = ()


_ENTRIES = tomllib.loads((files("femfit.tables") / "channels.toml").read_text(encoding="utf-8"))

CHANNELS: dict[str, Channel] = {
    name: Channel(
        **entry
        | {
            "names": tuple(word.lstrip("?") for word in entry.get("names", "").split()),
            "units": tuple(entry.get("units", ())),
        }
    )
    for name, entry in _ENTRIES.items()
}
"""Channel to its row."""

NEEDS_UNIT = frozenset(
    word[1:] for entry in _ENTRIES.values() for word in entry.get("names", "").split() if word.startswith("?")
)
"""Names that mean their channel only beside a unit of its kind."""
