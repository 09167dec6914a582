"""What was said of a campaign, beside what was hidden in it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from femfit.effects.catalogue import all_effects

COULD_BE_SHOWN = 24.0
"""Fall of the weighted sum of squares by the true error from which readings can show it."""

_POINTED_AT = 0.5
"""A channel is a right answer to "where" if an error shows there by this part of the most it does anywhere."""


@dataclass(frozen=True)
class Outcome:
    """One campaign and what was said of it."""

    number: int
    hidden: tuple[str, ...]
    groups: tuple[str, ...]  # Per hidden error: of the catalogue, a number of the drawing, not in all runs, unseen
    level: float
    could_be_shown: tuple[bool, ...]  # Per hidden error
    unknown: tuple[bool, ...]  # Per hidden error, whether the diagnosis has no name for it
    verdict: str
    classes: tuple[tuple[str, ...], ...]  # Each name with what it cannot be told from, itself first
    found: tuple[bool, ...]  # Per hidden error, whether some class has it
    named_first: bool
    certain: bool
    spurious: int  # Classes without any hidden error
    right_channel: bool
    right_runs: bool | None  # Onset and end within one run; None where there is none, or the diagnosis says none
    # With the hidden error out of the catalogue; None where that was not tried
    withheld_named: bool | None
    withheld_certain: bool | None

    @property
    def certain_and_wrong(self) -> bool:
        """Whether a diagnosis that was called certain holds a class without any hidden error."""
        return self.certain and self.spurious > 0


def judge(
    number: int, key: Mapping[str, Any], said: Mapping[str, Any], withheld: Mapping[str, Any] | None = None
) -> Outcome:
    """Compare the diagnosis with what was hidden; ``withheld`` is that without the hidden error in the catalogue."""
    hidden = tuple(key["hidden"])
    right = {name: key.get("right", {}).get(name, [name]) for name in hidden}
    classes = tuple(tuple(one["class"]) for one in said["missing"])
    known = {one["name"] for one in said.get("ranking", ())} or set(all_effects())
    channels: set[str] = set()
    for shown in key["over_noise"].values():
        channels |= {name for name, size in shown.items() if size >= _POINTED_AT * max(shown.values())}
    every = [name for names in right.values() for name in names]
    return Outcome(
        number=number,
        hidden=hidden,
        groups=tuple(key.get("group", {}).get(name, "catalogue") for name in hidden),
        level=key["level"],
        could_be_shown=tuple(
            key.get("shown", {}).get(name, COULD_BE_SHOWN if key["level"] >= 1.0 else 0.0) >= COULD_BE_SHOWN
            for name in hidden
        ),
        unknown=tuple(not says(known, right[name]) for name in hidden),
        verdict=said["verdict"],
        classes=classes,
        found=tuple(any(says(members, right[name]) for members in classes) for name in hidden),
        named_first=bool(classes) and says(classes[0][:1], every),
        certain=bool(said["confident"]),
        spurious=sum(not says(members, every) for members in classes),
        right_channel=said["where"]["channel"] in channels,
        right_runs=_right_runs(key, right, said),
        withheld_named=None if withheld is None else bool(withheld["missing"]),
        withheld_certain=None if withheld is None else bool(withheld["confident"]),
    )


def says(names: Iterable[str], right: Iterable[str]) -> bool:
    """Whether one of the names is right; numbers of a material's curve count by the material."""
    wanted = {_subject(name) for name in right}
    return any(_subject(name) in wanted for name in names)


def _subject(name: str) -> str:
    return name.rpartition(".")[0] if name.startswith("materials.") else name


def _right_runs(key: Mapping[str, Any], right: Mapping[str, list[str]], said: Mapping[str, Any]) -> bool | None:
    """Whether what was said of the runs in which an error acts holds within one run."""
    for name, (first, last) in key.get("when", {}).items():
        for one in said["missing"]:
            if one.get("when") and says(one["class"], right[name]):
                told = one["when"]
                begins, ends = told.get("first_run") or 1, told.get("last_run") or key["runs"]
                return bool(abs(begins - first) <= 1 and abs(ends - last) <= 1)
    return None
