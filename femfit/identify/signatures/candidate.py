"""An explanation: one effect, or two, refitted within bounds and tested again."""

from collections.abc import Sequence
from dataclasses import dataclass

from femfit.effects.effect import AddedEffect
from femfit.identify.decision.diagnosis import Gate
from femfit.identify.decision.evidence import Evidence
from femfit.identify.decision.scoring import Scored, further_effects, parameter_price
from femfit.identify.refit.refit import Refit, continued, refit

_STRUCTURE = 0.01
"""P-value below which a refit has left structure that more shapes of its effects are tried on."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect, or two, refitted to the readings.

    Parameters
    ----------
    cost : float
        Weighted sum of squares plus a price for every parameter.
    further : float
        Smallest p-value of a further effect beside it, times the number of effects.
    start : tuple of Scored
        The effects' columns and amplitudes that the refit began at.
    beside : tuple of Scored
        The other effects as they would go on from here, best first.
    """

    fit: Refit
    cost: float
    excess: float
    gate: Gate
    further: float
    start: tuple[Scored, ...]
    beside: tuple[Scored, ...]

    def passes(self, level: float) -> bool:
        """Whether it leaves neither structure nor anything for a further effect to explain."""
        return min(self.gate.p_value, self.further) > level


def refitted_candidates(evidence: Evidence, starts: Sequence[Sequence[Scored]]) -> list[Candidate]:
    """Refit combinations of effects.

    Parameters
    ----------
    starts : sequence of sequence of Scored
        Each a combination with amplitudes to start from.
    """
    result = []
    for start in starts:
        one = _refitted(evidence, start)
        if not one.passes(_STRUCTURE):
            # Shapes that did not pay for themselves to first order may do so about the refit
            whole = [_whole_family(evidence, item, added) for item, added in zip(start, one.fit.effects, strict=True)]
            if sum(map(_shapes, whole)) > sum(map(_shapes, start)):
                one = min(one, _refitted(evidence, whole), key=lambda candidate: candidate.cost)
        result.append(one)
    return sorted(result, key=lambda one: one.cost)


def _refitted(evidence: Evidence, start: Sequence[Scored]) -> Candidate:
    fit = refit(evidence.observations, evidence.whitening, [(one, amplitude) for one, _, amplitude, _ in start])
    # A constant that ended at its bound was searched for as well; it matters less than an amplitude
    amplitudes = sum(not p.nonlinear and not bound for (_, p), bound in zip(fit.free, fit.active, strict=True))
    constants = sum(p.nonlinear for _, p in fit.free)
    fitted = fit.jacobian[:, ~fit.active]
    beside, further = further_effects(evidence, fit.names, fit.rest, fitted)
    return Candidate(
        fit=fit,
        cost=fit.chi2 + parameter_price(fit.rest) * (amplitudes + 0.5 * constants),
        excess=evidence.patterns.excess(fit.rest, fitted),
        gate=evidence.patterns.test(fit.rest, fitted),
        further=further,
        start=tuple(start),
        beside=tuple(beside),
    )


def _shapes(item: Scored) -> int:
    return len(item[0].amplitudes)


def _whole_family(evidence: Evidence, item: Scored, added: AddedEffect) -> Scored:
    """All shapes of an effect, those that a refit used as it left them."""
    columns, white = max(
        ((one, white) for one, white in evidence.columns if one.effect.name == added.effect.name),
        key=lambda other: len(other[0].amplitudes),
    )
    columns, amplitude = continued(columns, added)
    return columns, white, amplitude, item[3]


def forward_pairs(singles: Sequence[Candidate], leading: int, wanted: int) -> list[list[Scored]]:
    """Pairs of a refitted effect and what goes on best from it.

    A first-order score misses an effect whose shape constants are far from where its columns were taken; a refit does
    not.

    Parameters
    ----------
    leading : int
        How many of them are continued.
    """
    pairs = []
    for one in singles[:leading]:
        (columns, white, _, fall), (added,) = one.start[0], one.fit.effects
        columns, amplitude = continued(columns, added)
        pairs += [[(columns, white, amplitude, fall), second] for second in one.beside[:wanted]]
    return pairs
