"""What a diagnosis says: the stable result of ``femfit diagnose``."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from femfit.core.results import Finding, Plotted
from femfit.effects.catalogue import device_effects, known_effect
from femfit.effects.words import smallest_visible, titled, titles_of
from femfit.identify.lack_of_fit import LackOfFit
from femfit.identify.misfit import ErrorFall, allowed, finer_sweep
from femfit.identify.noise.whitening import NoiseModel
from femfit.identify.observations import Observations
from femfit.identify.signatures import CHANGES_NOTHING
from femfit.identify.where import Where
from femfit.identify.words import Result, printed, sentence
from femfit.model.actuator_model import ActuatorModel

if TYPE_CHECKING:
    from femfit.identify.decision.campaign import Campaign
    from femfit.identify.decision.naming import Decision
    from femfit.identify.refit import Refit

Verdict = Literal["nothing_missing", "named", "form_insufficient", "unexplained", "compare_only"]


@dataclass(frozen=True)
class NamedEffect:
    """An effect that the verdict names."""

    name: str
    members: tuple[str, ...]  # The class: effects that would give the same readings, itself first
    tie: tuple[str, ...]  # Those of them that are as likely, itself first: the data do not choose among these
    explained_share: float  # Part of the structured misfit, above the noise, that all that is named explains
    parameters: Mapping[str, float]
    ci95: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # 95 % intervals
    words: tuple[str, ...] = ()
    tied_words: tuple[tuple[str, ...], ...] = ()  # Of the others of the tie, in their order
    plausible: bool = True  # Whether every parameter lies in its plausible range
    # First and last run in which it acts, counted from 1; None for all
    runs: tuple[int, int] | None = None

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data; ``members`` is called ``class``."""
        when = dict(zip(("first_run", "last_run"), self.runs, strict=True)) if self.runs else None
        rest = {key: value for key, value in vars(self).items() if key not in {"members", "tie", "runs"}}
        return rest | {"class": list(self.members), "tie": list(self.tie), "when": when}


@dataclass(frozen=True)
class ScoredEffect:
    """An effect of the catalogue as these data see it."""

    name: str
    # By how much it lowers the weighted sum of squares: refitted where ``error_left`` is a number, else to first
    # order
    chi2_fall: float
    degrees_of_freedom: int  # Number of its amplitudes that these data can see
    explained_share: float = float("nan")  # As in :class:`NamedEffect`; NaN where it was not refitted
    note: str = ""  # Why it cannot be tested; empty where it can
    # Rms error that it leaves alone, refitted, over the noise of one reading, all channels together; NaN where it was
    # not refitted
    error_left: float = float("nan")


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Plotted, Result):
    """The result of a diagnosis; printed, it is what ``femfit diagnose`` prints.

    Parameters
    ----------
    verdict : str
        ``nothing_missing``, ``named``, ``form_insufficient`` (the named effect is there, but its form leaves
        structure), ``unexplained`` (something is missing and none of the catalogue), ``compare_only`` (no verdict,
        since the noise is unknown or the readings are too few).
    where : Where
        Where the model fails before anything is added.
    error_fall : ErrorFall
        Error before, and with what is named.
    noise_floor : mapping of str to float
        Standard deviation of one reading per channel in which it is known.
    detectable : mapping of str to mapping of str to float
        Smallest magnitude of each effect's parameters that these data would have shown.
    probability : mapping of str to float
        Of each verdict but ``compare_only``.
    p_value : float
        Of the model's lack of fit, as in ``femfit compare``.
    own_misfit : bool
        Whether the model misses the readings by more than noise, but as its misfit to its own table may.
    excess : float
        Squared length of the misfit beyond what noise gives, in standard deviations.
    look_alikes : tuple of str
        Effects, or constant errors of a channel, that would bear the same name on these data, had they been the cause
        and not been listed.
    confident : bool
        Whether the verdict is ``named``, without look-alikes among the effects considered, with every parameter in
        its plausible range. The drawing's dimensions are among the effects
        considered where ``dimensions_suspected`` says so.
    excluded : tuple of str
        Effects that were not considered: nothing is certain beside them.
    campaign, decision : Campaign and Decision, or None
        What the result rests on; None for ``compare_only``.

    Examples
    --------
    >>> import femfit as ff
    >>> found = ff.diagnose(ff.read_model("model.json"), "bench.csv")
    >>> found.verdict
    'named'
    """

    data = (
        *("verdict", "probability", "noise_floor", "noise", "detectable", "p_value", "look_alikes"),
        *("confident", "dimensions_suspected", "excluded", "missing", "ranking", "where", "error_fall"),
        *("lack_of_fit_before", "lack_of_fit_after", "findings", "rms=error_fall.rms_before"),
    )

    verdict: Verdict
    ranking: tuple[ScoredEffect, ...]
    where: Where
    error_fall: ErrorFall
    model: ActuatorModel
    observations: Observations
    missing: tuple[NamedEffect, ...] = ()
    noise_floor: Mapping[str, float] = field(default_factory=dict)
    detectable: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    probability: Mapping[Verdict, float] = field(default_factory=dict)
    p_value: float = 1.0
    own_misfit: bool = False
    excess: float = 0.0
    lack_of_fit_before: LackOfFit | None = None
    lack_of_fit_after: LackOfFit | None = None
    look_alikes: tuple[str, ...] = ()
    confident: bool = False
    excluded: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    campaign: "Campaign | None" = None
    decision: "Decision | None" = None

    @property
    def rivals(self) -> tuple[str, ...]:
        """What would give the same readings as one of the names."""
        return tuple(dict.fromkeys(name for effect in self.missing for name in effect.members[1:]))

    @property
    def dimensions_suspected(self) -> bool:
        """Whether numbers of the drawing were among the suspects, as a sweep with signatures gives them."""
        return bool(self.observations.nominal.drawn)

    @property
    def explanations(self) -> "tuple[Refit, ...]":
        """What was named, then each other explanation that the data leave."""
        return tuple(explanation.fit for explanation in self.decision.left if explanation.fit) if self.decision else ()

    @property
    def noise(self) -> NoiseModel | None:
        """Variances of the readings; None where they are unknown."""
        return self.campaign.noise if self.campaign else None

    @property
    def allowed(self) -> Mapping[str, Any]:
        """What is granted of the errors with what is named."""
        return allowed(self.observations, self.noise, self.error_fall.rms_after)

    def __str__(self) -> str:
        after, nominal = self.allowed, self.observations.nominal
        effects, named = device_effects(nominal.circuits, nominal.drawn), {effect.name for effect in self.missing}
        hidden: dict[str, list[str]] = {}
        for score in self.ranking:
            if score.note:
                hidden.setdefault(score.note, []).append(score.name)
        text = printed(
            "diagnosis",
            d=self,
            a=after,
            symptoms={effect.name: getattr(known_effect(effect.name), "symptom", "") for effect in self.missing},
            blind=hidden.get(CHANGES_NOTHING, []),  # it may be missing all the same, since it changes no reading
            finer=finer_sweep(self.model),
            visible={
                name: smallest_visible(effects[name], amplitudes, nominal)
                for name, amplitudes in self.detectable.items()
                if name not in named
            },
            hidden=hidden,
        )
        return titled(text, titles_of(nominal.drawn))


def said_of(diagnosis: Diagnosis, what: str) -> str:
    """Its ``verdict`` in one sentence, or its ``certainty``: how far a name can be trusted against other causes."""
    return sentence("diagnosis", what, diagnosis, diagnosis.allowed)
