"""What learning a remainder says.

The measurement that would refute a remainder: where it and nothing differ most, and nobody has measured yet.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.text import amount, probability, rounded
from femfit.effects.conditions import Conditions
from femfit.identify.constants import HELPS, LEVEL_AFTER
from femfit.identify.noise.whitening import NoiseModel
from femfit.identify.readings.observations import Observations
from femfit.identify.refit.add_result import AddResult
from femfit.identify.remainder.constants import LEVELS, UNMEASURED
from femfit.identify.remainder.law import DEFINITIONS, ShortLaw
from femfit.identify.remainder.parts import WORDS
from femfit.identify.series.balances import FORCE_BALANCE
from femfit.model.actuator_model import ActuatorModel
from femfit.model.readings import predict_readings
from femfit.tables.measurement import CHANNEL_WORDS

_READS = {FORCE_BALANCE: "force_N", "voltage_balance_V": "voltage_V"}


@dataclass(frozen=True)
class Refutation:
    """A reading that the remainder says to be another than the model's."""

    channel: str
    distance_m: float
    current_A: float
    velocity_m_s: float
    change: float  # With the remainder less without
    noise: float  # Standard deviation of one reading
    measured: bool  # Whether something was measured next to it

    def __str__(self) -> str:
        where = f"{amount(self.distance_m, 'm', 3)} and {amount(self.current_A, 'A')}"
        where += f" while the body moves at {amount(self.velocity_m_s, 'm/s')}" if self.velocity_m_s else ""
        again = " once more, on a new mount" if self.measured else ", where nothing was measured"
        return (
            f"To refute it, read the {CHANNEL_WORDS[self.channel]} at {where}{again}: with the remainder it is "
            f"{amount(abs(self.change), self.channel)} {'more' if self.change > 0 else 'less'} than without, "
            f"{rounded(abs(self.change) / self.noise, 2)} times the noise of one reading."
        )


def refutation(
    before: ActuatorModel, after: ActuatorModel, observations: Observations, noise: NoiseModel
) -> Refutation | None:
    """The reading at which the remainder says most over its noise; None where it changes no static reading."""
    table = observations.covariates
    measured = [table[name].to_numpy() for name in ("distance_m", "current_A")]
    ends = [(float(x.min()), float(x.max())) for x in measured]
    speed = table["velocity_m_s"].abs().max() if "velocity_m_s" in table else 0.0
    braked = any(added.effect.force is not None for added in after.effects[len(before.effects) :])
    d, i = (np.ravel(x) for x in np.meshgrid(*(np.linspace(*e, n) for e, n in zip(ends, LEVELS, strict=True))))
    velocity = float(speed) if braked else 0.0
    at = Conditions(observations.nominal, velocity_m_s=velocity)
    readings = [predict_readings(one, d, i, at) for one in (before, after)]
    far = _farness(d, i, measured, ends)
    best: tuple[float, Refutation] | None = None
    for name, sigma in noise.floor.items():
        read = _READS.get(name, name)
        if name not in noise.source or read not in readings[0]:
            continue
        change = readings[1][read] - readings[0][read]
        new = far > UNMEASURED
        score = np.abs(change) / sigma * np.where(new, 1.0, 0.5 if new.any() else 1.0)
        k = int(np.argmax(score))
        if score[k] > 0.0 and (best is None or score[k] > best[0]):
            values = (float(d[k]), float(i[k]), velocity, float(change[k]), sigma, not bool(new[k]))
            best = float(score[k]), Refutation(read, *values)
    return None if best is None else best[1]


def _farness(d: FloatArray, i: FloatArray, measured: list[FloatArray], ends: list[tuple[float, float]]) -> FloatArray:
    """Distance of settings from the nearest that was measured, over the ranges of the data."""
    spans = [max(high - low, 1e-300) for low, high in ends]
    seen = np.unique(np.round(np.stack([x / s for x, s in zip(measured, spans, strict=True)], axis=1), 3), axis=0)
    here = np.stack([d / spans[0], i / spans[1]], axis=1)
    return np.asarray([np.sqrt(np.min(np.sum((seen - one) ** 2, axis=1))) for one in here])


@dataclass(frozen=True, eq=False, repr=False)
class RemainderResult(AddResult):
    """A remainder added to a model as the effect ``unexplained``; printed, it is what ``femfit add`` prints.

    Parameters
    ----------
    parts : tuple of str
        Where it acts: ``coenergy``, ``hall_field``, ``brake``, ``resistance``, or the setting or channel that is read
        wrongly; none where nothing beyond the noise is left.
    laws : tuple of ShortLaw
        For each part the short law that is nearest to it.
    alternatives : tuple of tuple of str
        Other parts that these readings leave possible.
    fall_unseen : float
        By how much it lowers the weighted sum of squares on runs left out.
    named_instead : str
        An effect of the catalogue that explains as much by itself; then the remainder is not accepted.
    beside : AddResult or None
        Effects that were added first.

    Examples
    --------
    >>> import femfit as ff
    >>> better = ff.add_effects(ff.read_model("model.json"), "bench.csv", "unexplained")
    >>> better.model.effects[-1].effect.name
    'unexplained'
    """

    parts: tuple[str, ...] = ()
    laws: tuple[ShortLaw, ...] = ()
    alternatives: tuple[tuple[str, ...], ...] = ()
    fall_unseen: float = 0.0
    refutation: Refutation | None = None
    named_instead: str = ""
    beside: AddResult | None = None

    @property
    def accepted(self) -> bool:
        """Whether it helps on runs left out, the filter is not worse, and no name explains as much."""
        filtered = self.filter is None or self.filter.accepted
        return bool(self.parts) and self.fall_unseen > HELPS and filtered and not self.named_instead

    def to_dict(self) -> dict[str, Any]:
        """As JSON-ready data, without the model."""
        return super().to_dict() | {
            "remainder": {
                "parts": list(self.parts),
                "alternatives": [list(one) for one in self.alternatives],
                "laws": [vars(law) for law in self.laws],
                "fall_unseen": self.fall_unseen,
                "refutation": None if self.refutation is None else vars(self.refutation),
                "named_instead": self.named_instead,
            },
            "beside": None if self.beside is None else self.beside.to_dict(),
        }

    def __str__(self) -> str:
        lines = [] if self.beside is None else [str(self.beside)]
        if not self.parts:
            return "\n".join([*lines, "Nothing was added: beyond the noise no remainder is left that could be learnt."])
        head, *others = super().__str__().split("\n")
        said = self.sentences
        return "\n".join(
            [*lines, head, *(f"  {one}" for one in said[: len(self.laws)]), *others, *said[len(self.laws) :]]
        )

    @property
    def sentences(self) -> list[str]:
        """The short law of each part, what else it may be, and the measurement that would refute it."""
        others = [" and ".join(WORDS[kind] for kind in one) for one in self.alternatives]
        also = [f"These readings also allow {'; or '.join(others)}."] if others else []
        return [*map(_law_sentence, self.laws), *also, *([] if self.refutation is None else [str(self.refutation)])]

    def _circumstances(self) -> list[str]:
        return []

    def _verdict(self) -> str:
        after = self.lack_of_fit_after.p_value
        left = "what is left is noise" if after > LEVEL_AFTER else "the misfit that is left is not noise"
        what = " and ".join(WORDS[kind] for kind in self.parts)
        if self.named_instead:
            return f"Not accepted: {self.named_instead}, a named effect, explains as much. Add that."
        if not self.accepted and self.fall_unseen <= HELPS:
            return f"Not accepted: with {what} learnt, the error on runs left out does not fall."
        if not self.accepted:
            return f"Not accepted: with {what} learnt, the filter is worse on runs left out."
        return f"Added as unexplained, for no cause is known: {what}; {left} ({probability(after)})."


def _law_sentence(law: ShortLaw) -> str:
    share = f"{100.0 * max(law.share, 0.0):.0f} %"
    if not law.fits:
        return f"No short law says the {DEFINITIONS[law.kind]}: the nearest has {share} of it."
    return f"A short law says {share} of it: {DEFINITIONS[law.kind]} = {law.text}."


def words_of(laws: tuple[ShortLaw, ...], parts: tuple[str, ...]) -> str:
    """What the effect is, as the clause that is printed wherever it is described."""
    said = {law.kind: law.text for law in laws if law.fits}
    each = (f"{DEFINITIONS[kind]} near {said[kind]}" if kind in said else WORDS[kind] for kind in parts)
    return f"of no known cause; {' and '.join(each)}"
