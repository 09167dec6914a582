"""What was said of a campaign, beside what was hidden in it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

COULD_BE_SHOWN = 24.0
"""Fall of the weighted sum of squares by the true error from which readings can show it."""

_POINTED_AT = 0.5
"""A channel is a right answer to "where" if an error shows there by this part of the most it does anywhere."""


@dataclass(frozen=True)
class Outcome:
    """One campaign and what was said of it."""

    number: int
    hidden: tuple[str, ...]
    level: float
    could_be_shown: tuple[bool, ...]  # Per hidden error
    verdict: str
    classes: tuple[tuple[str, ...], ...]  # Each name with what it cannot be told from, itself first
    found: tuple[bool, ...]  # Per hidden error, whether some class has it
    named_first: bool
    certain: bool
    spurious: int  # Classes without any hidden error
    right_channel: bool
    # With the hidden error out of the catalogue; None where that was not tried
    withheld_named: bool | None
    withheld_certain: bool | None

    @property
    def certain_and_wrong(self) -> bool:
        """Whether a diagnosis that was called certain holds a class without any hidden error."""
        return self.certain and self.spurious > 0


def judge(
    number: int, key: Mapping[str, Any], diagnosis: Mapping[str, Any], withheld: Mapping[str, Any] | None = None
) -> Outcome:
    """Compare the diagnosis with what was hidden; ``withheld`` is that without the hidden error in the catalogue."""
    hidden = tuple(key["hidden"])
    right = right_names(key)
    every = [name for names in right.values() for name in names]
    classes = tuple(tuple(cause["class"]) for cause in diagnosis["missing"])
    channels: set[str] = set()
    for over_noise in key["over_noise"].values():
        channels |= {name for name, size in over_noise.items() if size >= _POINTED_AT * max(over_noise.values())}
    return Outcome(
        number=number,
        hidden=hidden,
        level=key["level"],
        could_be_shown=tuple(
            key.get("shown", {}).get(name, COULD_BE_SHOWN if key["level"] >= 1.0 else 0.0) >= COULD_BE_SHOWN
            for name in hidden
        ),
        verdict=diagnosis["verdict"],
        classes=classes,
        found=tuple(any(says(members, right[name]) for members in classes) for name in hidden),
        named_first=bool(classes) and says(classes[0][:1], every),
        certain=bool(diagnosis["confident"]),
        spurious=sum(not says(members, every) for members in classes),
        right_channel=diagnosis["where"]["channel"] in channels,
        withheld_named=None if withheld is None else bool(withheld["missing"]),
        withheld_certain=None if withheld is None else bool(withheld["confident"]),
    )


def right_names(key: Mapping[str, Any]) -> dict[str, list[str]]:
    """By hidden error, the names of the diagnosis that say it."""
    return {name: key.get("right", {}).get(name, [name]) for name in key["hidden"]}


def says(names: Iterable[str], right: Iterable[str]) -> bool:
    """Whether one of the names is right; numbers of a material's curve count by the material."""
    wanted = {_subject(name) for name in right}
    return any(_subject(name) in wanted for name in names)


def _subject(name: str) -> str:
    return name.rpartition(".")[0] if name.startswith("materials.") else name
