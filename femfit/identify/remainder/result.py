"""What learning a remainder says."""

from dataclasses import dataclass
from typing import Any

from femfit.core.amount import probability
from femfit.identify.constants import HELPS, LEVEL_AFTER
from femfit.identify.refit.add_result import AddResult
from femfit.identify.remainder.law import DEFINITIONS, ShortLaw
from femfit.identify.remainder.parts import WORDS
from femfit.identify.remainder.refutation import Refutation


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
