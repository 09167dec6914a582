"""What a diagnosis says: the stable result of ``femfit diagnose``, and the facts that it prints beside its own.

One of these is how late the field follows a current. Where the current i changes slowly, eddy currents are e = -R^-1
C^T L di/dt. The field is that of i + C e, so that it follows late by C R^-1 C^T L. What ``eddy_current_lag`` finds adds
its own shares times their time constants.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from scipy import stats

from femfit.core.results import Finding
from femfit.effects.catalogue import device_effects, known_effect
from femfit.effects.lags import EDDY_CURRENT_LAG, slow_lag
from femfit.effects.words import smallest_visible, titled, titles_of
from femfit.identify.allowances import Allowed, allowed, finer_sweep
from femfit.identify.decision.constants import FALSE_NAMES
from femfit.identify.lack_of_fit import LackOfFit
from femfit.identify.misfit import ErrorFall
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
    p_value: float
    # Part of the structured misfit, above the noise, that all that is named explains on readings that it was not
    # fitted to; 1 for all
    explained_share: float
    parameters: Mapping[str, float]
    ci95: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # 95 % intervals
    words: tuple[str, ...] = ()
    tied_words: tuple[tuple[str, ...], ...] = ()  # Of the others of the tie, in their order
    plausible: bool = True  # Whether every parameter lies in its plausible range
    # First and last run in which it acts, counted from 1; None for all
    runs: tuple[int, int] | None = None

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data; ``members`` is called ``class``."""
        first, last = self.runs or (None, None)
        when = {"first_run": first, "last_run": last} if first else None
        rest = {key: value for key, value in vars(self).items() if key not in {"members", "tie", "runs"}}
        return rest | {"class": list(self.members), "tie": list(self.tie), "when": when}


@dataclass(frozen=True)
class ScoredEffect:
    """An effect of the catalogue as these data see it."""

    name: str
    p_value: float  # From its score test, nuisance removed; 1 where it cannot be tested
    # By how much it lowers the weighted sum of squares: refitted where ``error_left`` is a number, else to first
    # order
    chi2_fall: float
    degrees_of_freedom: int  # Number of its amplitudes that these data can see
    explained_share: float = float("nan")  # As in :class:`NamedEffect`; NaN where it was not refitted
    note: str = ""  # Why it cannot be tested; empty where it can
    # Rms error that it leaves alone, refitted, over the noise of one reading, all channels together; NaN where it was
    # not refitted
    error_left: float = float("nan")


@dataclass(frozen=True)
class CleanCampaigns:
    """How often the whole decision names something in simulated campaigns of this noise in which nothing is missing."""

    named: int
    campaigns: int

    @property
    def bound(self) -> float:
        """Upper end of the 95 % interval of the rate (Clopper and Pearson, Biometrika 26 (1934) 404)."""
        if self.named == self.campaigns:
            return 1.0
        return float(stats.beta.ppf(0.975, self.named + 1, self.campaigns - self.named))

    @property
    def name_too_often(self) -> bool:
        """Whether noise alone is given a name so often that no name is certain."""
        return self.named > FALSE_NAMES * self.campaigns

    def __str__(self) -> str:
        return f"{self.named} of {self.campaigns} simulated clean campaigns, at most {100.0 * self.bound:.2g} %"


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Result):
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
    clean : CleanCampaigns or None
        The bootstrap; None where none was asked for.
    probability : mapping of str to float
        Of each verdict but ``compare_only``.
    p_value : float
        Of the model's lack of fit, as in ``femfit compare``.
    own_misfit : bool
        Whether the model misses the readings by more than noise, but as its misfit to its own table may.
    times_own : float
        The misfit beyond noise over the model's own to its table; infinite where that is none.
    excess : float
        Squared length of the misfit beyond what noise gives, in standard deviations.
    dominant : NamedEffect or None
        Where no effect explains the misfit in all: one that explains most of it, with the part that it explains.
    look_alikes : tuple of str
        Effects, or constant errors of a channel, that would bear the same name on these data, had they been the cause
        and not been listed.
    confident : bool
        Whether the verdict is ``named``, without look-alikes among the effects considered, with every parameter in
        its plausible range, and noise alone is seldom given a name. The drawing's dimensions are among the effects
        considered where ``dimensions_suspected`` says so.
    excluded : tuple of str
        Effects that were not considered: nothing is certain beside them.
    campaign, decision : Campaign and Decision, or None
        What the result rests on; None for ``compare_only``.

    Examples
    --------
    >>> import femfit as ff
    >>> found = ff.diagnose(ff.read_model("model.json"), "bench.csv", bootstrap=0)
    >>> found.verdict
    'named'
    """

    data = (
        *("verdict", "probability", "noise_floor", "detectable", "false_naming_rate", "p_value", "look_alikes"),
        *("confident", "dimensions_suspected", "excluded", "missing", "dominant", "ranking", "where", "error_fall"),
        *("lack_of_fit_before", "lack_of_fit_after", "findings"),
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
    clean: CleanCampaigns | None = None
    probability: Mapping[Verdict, float] = field(default_factory=dict)
    p_value: float = 1.0
    own_misfit: bool = False
    times_own: float = float("inf")
    excess: float = 0.0
    lack_of_fit_before: LackOfFit | None = None
    lack_of_fit_after: LackOfFit | None = None
    dominant: NamedEffect | None = None
    look_alikes: tuple[str, ...] = ()
    confident: bool = False
    excluded: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    campaign: "Campaign | None" = None
    decision: "Decision | None" = None

    @property
    def false_naming_rate(self) -> float | None:
        """Share of simulated clean campaigns in which something would have been named."""
        return None if self.clean is None else self.clean.named / self.clean.campaigns

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

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data."""
        clean = self.clean and {**vars(self.clean), "bound": self.clean.bound}
        return super().to_dict() | {"rms": self.error_fall.rms_before, "clean_campaigns": clean}

    @property
    def allowed(self) -> Allowed:
        """What is granted of the errors with what is named."""
        noise = self.campaign.noise if self.campaign else None
        return allowed(self.observations, noise, self.error_fall.rms_after)

    def __str__(self) -> str:
        after, nominal = self.allowed, self.observations.nominal
        misses = bool(after.apart) or self.verdict not in {"nothing_missing", "named"}
        effects, named = device_effects(nominal.circuits, nominal.drawn), {effect.name for effect in self.missing}
        shown = [effect for effect in (*self.missing, self.dominant) if effect]
        hidden: dict[str, list[str]] = {}
        for score in self.ranking:
            if score.note:
                hidden.setdefault(score.note, []).append(score.name)
        text = printed(
            "diagnosis",
            d=self,
            a=after,
            symptoms={effect.name: getattr(known_effect(effect.name), "symptom", "") for effect in shown},
            lagging=None if misses else _lag(self),
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


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence."""
    return sentence("diagnosis", "verdict", diagnosis, diagnosis.allowed)


def certainty_sentence(diagnosis: Diagnosis) -> str:
    """How far what is named can be trusted against other causes."""
    return sentence("diagnosis", "certainty", diagnosis)


@dataclass(frozen=True)
class _Lag:
    """How late the field follows a slow current, as drawn, and by how much more; None where it is as drawn."""

    drawn_s: float
    more_s: float | None
    distance_m: float
    current_A: float


def _lag(diagnosis: Diagnosis) -> _Lag | None:
    """The lag, where the drawing has eddy currents, the data show them, and nothing else could stand for it.

    The conductivity of one of several materials changes the lag, too, but the model's states do not say by how much.
    """
    base = diagnosis.model.without_effects
    lags = {EDDY_CURRENT_LAG.name, *(number.key for number in base.drawn if number.conducts)}
    named = {effect.name: effect.parameters for effect in diagnosis.missing if effect.name in lags}
    alike = {name for effect in diagnosis.missing for name in effect.members if effect.name not in lags}
    if base.eddy is None or len(base.circuits) != 1 or not (named or lags & diagnosis.detectable.keys()):
        return None
    parts = {number.key for number in base.drawn if number.key.endswith("conductivity_MS_per_m")} - lags
    if (lags | parts) & alike or diagnosis.observations.away_from_bias:
        return None
    setting = diagnosis.observations.covariates[["distance_m", "current_A"]].mean()
    d, i = np.asarray(setting["distance_m"]), np.asarray(setting["current_A"])
    inductance, (forms,) = base.magnetics.inductance(d, i[..., None])[..., 0, 0], base.eddy.forms(d)
    drawn = float((forms.coupling[0] ** 2 / base.eddy.resistances_ohm).sum() * inductance)
    more = [slow_lag(p) if name == EDDY_CURRENT_LAG.name else drawn * p["change"] for name, p in named.items()]
    return _Lag(drawn, sum(more) if named else None, float(d), float(i))
