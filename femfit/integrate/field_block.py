"""What every integrator gives back, and what every integrator is."""

from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.integrate.uncertainty import Responses, Systematics
from femfit.tables.coil_block import CoilBlock


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
    responses : Responses or None
        To what is systematic; None where nothing systematic was asked for.
    """

    time: FloatArray
    field: FloatArray
    variance: FloatArray
    offset: FloatArray
    innovation: FloatArray
    innovation_variance: FloatArray
    responses: Responses | None = None

    def sigma(self, systematics: Systematics | None = None) -> FloatArray:
        """Combined standard uncertainty in T: noise, and systematics where given."""
        if systematics is None or self.responses is None:
            return np.sqrt(self.variance)
        return np.asarray(np.sqrt(self.variance + self.responses.variance(systematics)))


State = TypeVar("State")


class Integrator(Protocol[State]):
    """From coil blocks to field blocks; never changed by running, every call returns the state for the next one.

    Offline a record is one block or a few large ones, online each sample is a block: the numbers are the same.
    """

    def start(self) -> State:
        """The state before the first sample."""
        ...

    def advance(self, state: State, block: CoilBlock) -> tuple[State, FieldBlock]:
        """Take a block in."""
        ...


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

    Returns
    -------
    int
        0 for a filter that has a field.
    """
    if not np.isnan(field):
        return 0
    known = np.flatnonzero(np.isfinite(readings))
    return int(known[0]) if len(known) else len(readings)


def joined(blocks: list[FieldBlock]) -> FieldBlock:
    """Consecutive field blocks as one."""

    def whole(pieces: list[FloatArray]) -> FloatArray:
        return np.concatenate(pieces)

    answers = [block.responses for block in blocks if block.responses is not None]
    responses = None
    if len(answers) == len(blocks):
        responses = Responses(
            whole([answer.coil for answer in answers]),
            whole([answer.reference for answer in answers]),
            whole([answer.reference_unit for answer in answers]),
            whole([answer.voltage_unit for answer in answers]),
        )
    return FieldBlock(
        whole([block.time for block in blocks]),
        whole([block.field for block in blocks]),
        whole([block.variance for block in blocks]),
        whole([block.offset for block in blocks]),
        whole([block.innovation for block in blocks]),
        whole([block.innovation_variance for block in blocks]),
        responses,
    )
