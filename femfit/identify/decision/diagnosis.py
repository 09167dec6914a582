"""What a diagnosis says: the stable result of ``femfit diagnose``."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from femfit.core.finding import Finding

Verdict = Literal["nothing_missing", "named", "form_insufficient", "unexplained", "compare_only"]


@dataclass(frozen=True)
class Where:
    """Where the model fails.

    Parameters
    ----------
    channel : str
        The measured channel with the largest misfit over its noise floor; empty where nothing fails.
    covariates : tuple of str
        Columns along which the misfit changes, the strongest first.
    """

    channel: str
    covariates: tuple[str, ...]
    sentence: str


@dataclass(frozen=True)
class Gate:
    """A structured lack-of-fit test.

    Parameters
    ----------
    statistic : float
        Squared length of the whitened residual in the space of smooth patterns, over its degrees of freedom.
    p_value : float
        Probability of at least this statistic where nothing is missing.
    """

    statistic: float
    degrees_of_freedom: int
    p_value: float


@dataclass(frozen=True)
class NamedEffect:
    """An effect that the verdict names.

    Parameters
    ----------
    members : tuple of str
        The class: effects that these data cannot tell from it, itself first.
    error_fall : float
        Part of the structured misfit, above the noise, that all that is named explains on runs left out; 1 for all.
    ci95 : mapping of str to (float, float)
        95 % intervals.
    sane : bool
        Whether every parameter lies in its usual range.
    """

    name: str
    members: tuple[str, ...]
    p_value: float
    error_fall: float
    parameters: Mapping[str, float]
    ci95: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    sane: bool = True


@dataclass(frozen=True)
class ScoredEffect:
    """An effect of the catalogue as these data see it.

    Parameters
    ----------
    p_value : float
        Of its score test, nuisance removed; 1 where it cannot be tested.
    chi2_fall : float
        By how much it lowers the weighted sum of squares.
    degrees_of_freedom : int
        Shapes that these data can see.
    error_fall : float
        As in :class:`NamedEffect`; NaN where it was not refitted.
    note : str
        Why it cannot be tested; empty where it can.
    """

    name: str
    p_value: float
    chi2_fall: float
    degrees_of_freedom: int
    error_fall: float = float("nan")
    note: str = ""


@dataclass(frozen=True)
class Diagnosis:
    """The result of a diagnosis.

    Parameters
    ----------
    verdict : str
        ``nothing_missing``, ``named``, ``form_insufficient`` (the named effect is there, but its shapes leave
        structure),
        ``unexplained`` (something is missing and none of the catalogue), ``compare_only`` (no noise floor).
    where : Where
        Where the model fails before anything is added.
    noise_floor, rms, rms_after : mapping of str to float
        Per channel: standard deviation of a reading, root mean square of the misfit, and the same with what was named.
    detectable : mapping of str to mapping of str to float
        Smallest magnitude of each effect's parameters that these data would have shown.
    false_naming_rate : float or None
        Share of clean data, simulated from the noise model, in which something would have been named.
    look_alikes : tuple of str
        Effects, or constant errors of a channel, that would bear the same name on these data, had they been the cause
        and not been listed.
    confident : bool
        Whether the verdict is ``named``, without look-alikes and with every parameter in its usual range.
    findings : tuple of str
        What the reader should know of the data and of the decision, one plain sentence each.
    """

    verdict: Verdict
    missing: tuple[NamedEffect, ...]
    ranking: tuple[ScoredEffect, ...]
    where: Where
    noise_floor: Mapping[str, float]
    rms: Mapping[str, float]
    rms_after: Mapping[str, float]
    detectable: Mapping[str, Mapping[str, float]]
    false_naming_rate: float | None
    gate_before: Gate | None = None
    gate_after: Gate | None = None
    look_alikes: tuple[str, ...] = ()
    confident: bool = False
    findings: tuple[Finding, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data; ``members`` is called ``class``."""
        data = asdict(self)
        for one in data["missing"]:
            one["class"] = list(one.pop("members"))
        return data
