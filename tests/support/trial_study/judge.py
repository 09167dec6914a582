"""What was right and what was wrong in a diagnosis, once the key is open.

Reads nothing but the diagnosis JSON of ``femfit diagnose``, so that any engine that writes it can be judged.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

_SHOWN = 0.5
"""A channel counts as a right answer to "where" if the effect shows there by this part of the most it does anywhere."""


@dataclass(frozen=True)
class Judgement:
    """One case.

    Parameters
    ----------
    classes : tuple of tuple of str
        What they cannot be told from, themselves first.
    in_class : tuple of bool
        Per hidden effect, whether some class has it.
    first : bool
        Whether the first name is a hidden effect.
    withheld_verdict, withheld_twins_verdict : str
        With the effect, or with it and those that no bench tells from it, out of the catalogue; empty where not tried.
    confident, withheld_confident, withheld_twins_confident : bool
        Whether the diagnosis called what it named sure, with the whole catalogue and with effects withheld.
    confounded : bool
        Whether what was named with the effect withheld had stood in its class: these data do not tell them apart.
    right_channel, right_covariate : bool or None
        Of ``where``; None without an effect.
    unseen_over_floor : float or None
        Rms on the unseen run after adding what was named over that of a perfect model, all channels.
    """

    case: int
    actuator: str
    effects: tuple[str, ...]
    level: float
    all_channels: bool
    verdict: str
    named: tuple[str, ...]
    classes: tuple[tuple[str, ...], ...]
    in_class: tuple[bool, ...]
    first: bool
    spurious: int
    withheld_verdict: str
    withheld_named: tuple[str, ...]
    withheld_twins_verdict: str
    withheld_twins_named: tuple[str, ...]
    confident: bool
    withheld_confident: bool
    withheld_twins_confident: bool
    confounded: bool
    right_channel: bool | None
    right_covariate: bool | None
    unseen_over_floor: float | None
    seconds: float
    baselines: Mapping[str, tuple[str, ...]]

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        return asdict(self)


def judge(key: Mapping[str, Any], answers: Mapping[str, Any]) -> Judgement:
    """Compare answers with a case's key.

    Parameters
    ----------
    answers : mapping
        ``full``, and where they were tried ``withheld`` and ``withheld_twins``: diagnosis JSON; ``unseen_rms`` per
        channel; ``baselines``: names per method.
    """
    order, full = key["order"], answers["full"]
    hidden = tuple(order["effects"])
    classes = tuple(tuple(one["class"]) for one in full["missing"])
    withheld, twins = answers.get("withheld"), answers.get("withheld_twins")
    channel, covariate = _where(key, full["where"]) if hidden else (None, None)
    withheld_names = _names(withheld)
    return Judgement(
        case=order["number"],
        actuator=order["actuator"],
        effects=hidden,
        level=order["level"],
        all_channels=key["all_channels"],
        verdict=full["verdict"],
        named=_names(full),
        classes=classes,
        in_class=tuple(any(name in members for members in classes) for name in hidden),
        first=bool(classes) and classes[0][0] in hidden,
        spurious=sum(not set(members) & set(hidden) for members in classes),
        withheld_verdict=withheld["verdict"] if withheld else "",
        withheld_named=withheld_names,
        withheld_twins_verdict=twins["verdict"] if twins else "",
        withheld_twins_named=_names(twins),
        confident=_confident(full),
        withheld_confident=_confident(withheld),
        withheld_twins_confident=_confident(twins),
        confounded=any(set(members) & set(hidden) and set(members) & set(withheld_names) for members in classes),
        right_channel=channel,
        right_covariate=covariate,
        unseen_over_floor=_over_floor(answers.get("unseen_rms"), key["unseen_floor"]),
        seconds=full["seconds"],
        baselines={name: tuple(found) for name, found in answers.get("baselines", {}).items()},
    )


def _names(diagnosis: Mapping[str, Any] | None) -> tuple[str, ...]:
    return tuple(one["name"] for one in diagnosis["missing"]) if diagnosis else ()


def _confident(diagnosis: Mapping[str, Any] | None) -> bool:
    return bool(diagnosis and diagnosis.get("confident"))


def _where(key: Mapping[str, Any], where: Mapping[str, Any]) -> tuple[bool, bool]:
    """Whether the channel is one where a hidden effect shows, and a covariate one that it changes with."""
    channels: set[str] = set()
    along: set[str] = set()
    constant = False
    for effect in key["effects"]:
        most = max(effect["over_noise"].values())
        shown = {name for name, size in effect["over_noise"].items() if size >= _SHOWN * most}
        channels |= set(effect.get("channels", shown))  # of a time series, the balances in which it shows
        along |= set(effect["along"])
        constant |= not effect["along"] or where["channel"] in effect.get("even", ())
    given: Sequence[str] = where["covariates"]
    return where["channel"] in channels, bool(along & set(given)) or (constant and not given)


def _over_floor(rms: Mapping[str, float] | None, floor: Mapping[str, float]) -> float | None:
    shared = [name for name in floor if rms and name in rms]
    if not rms or not shared:
        return None
    return float((sum((rms[name] / floor[name]) ** 2 for name in shared) / len(shared)) ** 0.5)
