"""What every integrator gives back.

An integrator has ``start()``, the state before the first sample, and ``advance(state, block)``, which returns the next
state and the block's field; running never changes it. Offline a record is one block or a few large ones, online each
sample is a block: the numbers are the same.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.integrate.uncertainty import Responses, Systematics


@dataclass(frozen=True, eq=False)
class FieldBlock:
    """The integrated field, a value for each sample of a coil block.

    Parameters
    ----------
    time : array, shape (n,)
        In s.
    field : array, shape (n,)
        B in T (a flux linkage in Wb where the coil's area is 1).
    variance : array, shape (n,)
        Of white noise, in T^2.
    offset : array, shape (n,)
        Estimated offset voltage in V; of one-state filters what their corrections amount to, averaged over a second.
    innovation, innovation_variance : array, shape (n,)
        Reference minus prediction where a reading was used, NaN elsewhere; T and T^2.
    """

    time: FloatArray
    field: FloatArray
    variance: FloatArray
    offset: FloatArray
    innovation: FloatArray
    innovation_variance: FloatArray
    responses: Responses

    def sigma(self, systematics: Systematics | None = None) -> FloatArray:
        """Combined standard uncertainty in T: noise, and systematics where given."""
        if systematics is None:
            return np.sqrt(self.variance)
        return np.asarray(np.sqrt(self.variance + self.responses.variance(systematics)))


def unknown_block(time: FloatArray) -> FieldBlock:
    """A field block of which nothing is known yet: NaN throughout.

    Parameters
    ----------
    time : array, shape (n,)
        Of its samples, s.
    """
    field, variance, offset, innovation, innovation_variance = (np.full(len(time), np.nan) for _ in range(5))
    coil, reference, reference_unit, voltage_unit = (np.full(len(time), np.nan) for _ in range(4))
    responses = Responses(coil, reference, reference_unit, voltage_unit)
    return FieldBlock(time, field, variance, offset, innovation, innovation_variance, responses)


def leading_unknown(field: float, readings: FloatArray) -> int:
    """How many samples pass before a filter without an initial field knows one.

    Parameters
    ----------
    field : float
        Its state; NaN before the first reading.
    readings : array, shape (n,)
        Of its reference, NaN where there is none.
    """
    if not np.isnan(field):
        return 0
    known = np.flatnonzero(np.isfinite(readings))
    return int(known[0]) if len(known) else len(readings)


def joined(blocks: list[FieldBlock]) -> FieldBlock:
    """Consecutive field blocks as one."""

    def whole(name: str) -> FloatArray:
        return np.concatenate([getattr(block, name) for block in blocks])

    def answers(name: str) -> FloatArray:
        return np.concatenate([getattr(block.responses, name) for block in blocks])

    responses = Responses(answers("coil"), answers("reference"), answers("reference_unit"), answers("voltage_unit"))
    innovations = whole("innovation"), whole("innovation_variance")
    return FieldBlock(whole("time"), whole("field"), whole("variance"), whole("offset"), *innovations, responses)
