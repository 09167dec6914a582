"""The seven methods by name, with noise evaluated from the record (type A) and systematics as given (type B).

References
----------
JCGM 100:2008 (GUM), 4.2 and 4.3.
P. Arpaia et al., Sensors 22 (2022) 182, sections 2.4, 2.5 and 3.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import TableError
from femfit.integrate.feed_forward import FeedForwardIntegrator
from femfit.integrate.field_block import FieldBlock
from femfit.integrate.kalman import KalmanIntegrator
from femfit.integrate.offset_filter import OffsetFilter
from femfit.integrate.offset_rules import NoOffset, OffsetRule, PlateauMean, ZeroReading
from femfit.integrate.uncertainty import (
    PAPER_CURRENT_TO_FIELD,
    LinearSigma,
    Noise,
    SensingCoil,
    Systematics,
    paper_noise,
)
from femfit.model.field_of_current import FieldModel
from femfit.tables.coil_block import CoilBlock

Method = Literal["trapezoid", "ffa1", "ffa2", "cs1", "cs2", "cs1-offset", "cs2-identified"]
Treatment = Literal["gum", "paper"]
AnyIntegrator: TypeAlias = FeedForwardIntegrator | KalmanIntegrator | OffsetFilter

_FEED_FORWARD = ("trapezoid", "ffa1", "ffa2")
_HALL = ("cs1", "cs1-offset")

# Second differences of white noise have six times its variance; the median of |normal| is 0.6745 sigma.
_MEDIAN_TO_SIGMA = 1.0 / (0.6745 * math.sqrt(6.0))


@dataclass(frozen=True)
class IntegrationOptions:
    """What a method is told besides the record.

    Parameters
    ----------
    coil : SensingCoil
        Area 1 makes fields flux linkages; feed-forward methods only.
    treatment : str
        ``gum``: noise from the record, systematics apart. ``paper``: (11) and sections 2.4 and 2.5 to the letter.
    initial_field : float or None
        B_0; None is 0 for feed-forward methods, and the reference's first reading for filters.
    settling : float or None
        Of ffa2, s; None takes the paper's by ramp rate.
    still_A : float
        Of ffa2: a current that moves by less in a second is on a plateau.
    systematics : Systematics
        As given; 0 where nothing is known.
    """

    method: Method
    coil: SensingCoil
    treatment: Treatment = "gum"
    initial_field: float | None = None
    zero_reading: float = 60.0
    settling: float | None = None
    still_A: float = 0.1
    current_to_field: float = PAPER_CURRENT_TO_FIELD
    field_model: FieldModel | None = None
    systematics: Systematics = Systematics()  # noqa: RUF009  # frozen

    @property
    def of_hall(self) -> bool:
        """Whether the reference is a Hall probe."""
        return self.method in _HALL


def make_integrator(options: IntegrationOptions, first: CoilBlock) -> AnyIntegrator:
    """The integrator of a method.

    Parameters
    ----------
    first : CoilBlock
        The record's first block: its sample time and its noise.

    Raises
    ------
    TableError
        If the block is too short, or lacks what the method needs.
    """
    dt = sample_time(first)
    noise = record_noise(options, first, dt)
    if options.method in _FEED_FORWARD:
        settling = (20.0, 25.0, 30.0) if options.settling is None else (options.settling,) * 3
        rules: dict[str, OffsetRule] = {
            "trapezoid": NoOffset(),
            "ffa1": ZeroReading(options.zero_reading),
            "ffa2": PlateauMean(settling=settling, still_A=options.still_A),
        }
        return FeedForwardIntegrator(options.coil, noise, dt, rules[options.method], options.initial_field or 0.0)
    initial = math.nan if options.initial_field is None else options.initial_field
    if options.method in {"cs1", "cs2"}:
        ratio = options.current_to_field if options.method == "cs2" else None
        gum = options.treatment == "gum"
        return KalmanIntegrator(options.coil, noise, dt, ratio, initial, sensitivities=gum)
    if options.method == "cs2-identified" and options.field_model is None:
        raise TableError("cs2-identified needs a field model: give --field-model, or --lab with a Hall probe's record.")
    return OffsetFilter(options.coil, noise, dt, options.field_model if not options.of_hall else None, initial)


def sample_time(block: CoilBlock) -> float:
    """Nominal sample time, the median difference.

    Raises
    ------
    TableError
        If the block is shorter.
    """
    if len(block) < 3:
        raise TableError(f"A record needs at least 3 samples; instead received {len(block)}.")
    return float(np.median(np.diff(block.time)))


def record_noise(options: IntegrationOptions, first: CoilBlock, dt: float) -> Noise:
    """White noise of the samples: the paper's by name, or what the record's first block shows.

    Returns
    -------
    Noise
        Type A where the treatment is ``gum``; cs2's reference keeps the paper's spread about I/g, which is an error of
        the model and cannot be read from the record.
    """
    literal = paper_noise("hall" if options.of_hall else "current", 1.0 / dt)
    if options.treatment == "paper":
        return literal
    voltage = LinearSigma(white_sigma(first.voltage))
    if not options.of_hall:
        known = 0.0 if options.field_model is None else 3.0 * options.field_model.rms_T
        return Noise(voltage, literal.reference, max(literal.initial_T, 3e-3, known))
    if first.hall is None:
        raise TableError(f"{options.method} needs hall_T; instead received a record without it.")
    hall = white_sigma(first.hall)
    return Noise(voltage, LinearSigma(hall), max(10.0 * hall, 1e-3))


def white_sigma(values: FloatArray) -> float:
    """Standard deviation of white noise on a slow signal, from second differences.

    Parameters
    ----------
    values : array, shape (n,)
        In any unit; NaN are left out.

    Returns
    -------
    float
        In the values' unit; at least 1e-9 of their largest, so that noiseless data can be weighed.
    """
    known = values[np.isfinite(values)]
    if len(known) < 3:
        raise TableError(f"Noise cannot be evaluated from {len(known)} readings in the first block; give at least 3.")
    bends = np.abs(np.diff(known, 2))
    # The median of coarsely quantised readings may be 0; their mean is not.
    centre = float(np.median(bends)) or 0.845 * float(np.mean(bends))
    return max(centre * _MEDIAN_TO_SIGMA, 1e-9 * float(np.abs(known).max()), 1e-15)


def integrate_blocks(integrator: AnyIntegrator, blocks: Iterable[CoilBlock]) -> Iterator[tuple[CoilBlock, FieldBlock]]:
    """Stream a record through an integrator."""
    state: Any = integrator.start()
    for block in blocks:
        state, out = integrator.advance(state, block)
        yield block, out
