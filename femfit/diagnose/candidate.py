"""An explanation: one effect, or two, refitted within bounds and tested again."""

from collections.abc import Sequence
from dataclasses import dataclass

from femfit.diagnose.diagnosis import Gate
from femfit.diagnose.evidence import Evidence
from femfit.diagnose.refit import Refit, refit
from femfit.diagnose.scoring import Scored, further_effect, parameter_price


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect, or two, refitted to the readings.

    Parameters
    ----------
    fit : Refit
        With bounds.
    cost : float
        Weighted sum of squares plus a price for every parameter.
    excess : float
        Structured excess that it leaves.
    gate : Gate
        The test after it.
    further : float
        Smallest p-value of a further effect beside it, times the number of effects.
    """

    fit: Refit
    cost: float
    excess: float
    gate: Gate
    further: float

    def passes(self, level: float) -> bool:
        """Whether it leaves neither structure nor anything for a further effect to explain."""
        return min(self.gate.p_value, self.further) > level


def refitted_candidates(evidence: Evidence, starts: Sequence[Sequence[Scored]]) -> list[Candidate]:
    """Refit combinations of effects.

    Parameters
    ----------
    evidence : Evidence
        Of the readings.
    starts : sequence of sequence of Scored
        Each a combination with amplitudes to start from.

    Returns
    -------
    list of Candidate
        Cheapest first.
    """
    result = []
    for start in starts:
        fit = refit(evidence.observations, evidence.whitening, [(one, amplitude) for one, _, amplitude, _ in start])
        constants = sum(p.shape for _, p in fit.free)
        price = parameter_price(fit.rest) * (fit.used - 0.5 * constants)
        fitted = fit.jacobian[:, ~fit.active]
        result.append(
            Candidate(
                fit=fit,
                cost=fit.chi2 + price,
                excess=evidence.patterns.excess(fit.rest, fitted),
                gate=evidence.patterns.test(fit.rest, fitted),
                further=further_effect(evidence, fit.names, fit.rest, fitted),
            )
        )
    return sorted(result, key=lambda one: one.cost)
