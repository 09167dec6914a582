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
from femfit.integrate.constants import FIRST_FIELD_SIGMA_T, MODEL_ERROR_TIME_S, SETTLING_S
from femfit.integrate.feed_forward import FeedForwardIntegrator
from femfit.integrate.field_block import FieldBlock
from femfit.integrate.field_of_current import FieldModel
from femfit.integrate.kalman import KalmanIntegrator
from femfit.integrate.offset_filter import OffsetFilter
from femfit.integrate.offset_rules import NoOffset, OffsetRule, PlateauMean, ZeroReading
from femfit.integrate.uncertainty import LinearSigma, Noise, SensingCoil, Systematics
from femfit.tables.coil_block import CoilBlock

Method = Literal["trapezoid", "ffa1", "ffa2", "cs1", "cs2", "cs1-offset", "cs2-identified"]
AnyIntegrator: TypeAlias = FeedForwardIntegrator | KalmanIntegrator | OffsetFilter

FEED_FORWARD = ("trapezoid", "ffa1", "ffa2")
_HALL = ("cs1", "cs1-offset")

# Second differences of white noise have six times its variance; the median of |normal| is 0.6745 sigma.
_MEDIAN_TO_SIGMA = 1.0 / (0.6745 * math.sqrt(6.0))


@dataclass(frozen=True)
class IntegrationOptions:
    """What a method is given besides the record.

    Parameters
    ----------
    coil : SensingCoil
        Area 1 makes fields flux linkages; feed-forward methods and swept models only.
    initial_field : float or None
        B_0; None is 0 for feed-forward methods, and the reference's first reading for filters.
    zero_reading : float or None
        Length of ffa1's zero reading at the record's begin, s.
    still_A : float
        Of ffa2: a current that moves by less in a second is on a plateau.
    current_to_field : float or None
        g of cs2 in A/T.
    noise : Noise or None
        White noise of the samples; None evaluates it from the record's first block.
    """

    method: Method
    coil: SensingCoil
    initial_field: float | None = None
    zero_reading: float | None = None
    settling: float = SETTLING_S
    still_A: float = 0.1
    current_to_field: float | None = None
    field_model: FieldModel | None = None
    systematics: Systematics = Systematics()  # noqa: RUF009  # frozen
    noise: Noise | None = None

    @property
    def of_hall(self) -> bool:
        """Whether the reference is a Hall probe."""
        return self.method in _HALL


def make_integrator(options: IntegrationOptions, first: CoilBlock) -> AnyIntegrator:
    """The integrator of a method."""
    if options.method == "cs2-identified" and options.field_model is None:
        raise TableError("cs2-identified needs a field model: give --field-model, or --lab with a Hall probe's record.")
    dt = sample_time(first)
    noise = options.noise or record_noise(options, first, dt)
    if options.method in FEED_FORWARD:
        return FeedForwardIntegrator(options.coil, noise, dt, _offset_rule(options), options.initial_field or 0.0)
    initial = math.nan if options.initial_field is None else options.initial_field
    if options.method in {"cs1", "cs2"}:
        ratio = _current_to_field(options) if options.method == "cs2" else None
        return KalmanIntegrator(options.coil, noise, dt, ratio, initial)
    return OffsetFilter(options.coil, noise, dt, options.field_model if not options.of_hall else None, initial)


def _offset_rule(options: IntegrationOptions) -> OffsetRule:
    if options.method == "trapezoid":
        return NoOffset()
    if options.method == "ffa2":
        return PlateauMean(settling=options.settling, still_A=options.still_A)
    if options.zero_reading is None:
        raise TableError(
            "ffa1 takes the offset voltage from the record's begin, while nothing moves: give its length with "
            "--zero-reading-s."
        )
    return ZeroReading(options.zero_reading)


def _current_to_field(options: IntegrationOptions) -> float:
    if options.current_to_field is None:
        raise TableError(
            "cs2 takes the current over the magnet's current-to-field ratio for a field: give that ratio in A/T with "
            "--current-to-field."
        )
    return options.current_to_field


def sample_time(block: CoilBlock) -> float:
    """Nominal sample time, the median difference."""
    if len(block) < 3:
        raise TableError(f"A record needs at least 3 samples; instead received {len(block)}.")
    return float(np.median(np.diff(block.time)))


def record_noise(options: IntegrationOptions, first: CoilBlock, dt: float) -> Noise:
    """White noise of the samples as the record's first block shows it (type A).

    An error of the current's field that was given, as a gain or an offset, counts as noise that lasts
    :data:`MODEL_ERROR_TIME_S`: the filter must not trust I / g to the current's noise.
    """
    voltage = LinearSigma(white_sigma(first.voltage))
    if options.method in FEED_FORWARD:
        return Noise(voltage, LinearSigma(0.0), 0.0)
    if options.of_hall:
        if first.hall is None:
            raise TableError(f"{options.method} needs hall_T; instead received a record without it.")
        hall = white_sigma(first.hall)
        return Noise(voltage, LinearSigma(hall), max(10.0 * hall, 1e-3))
    if options.field_model is not None:  # which brings its own error
        return Noise(voltage, LinearSigma(0.0), max(FIRST_FIELD_SIGMA_T, 3.0 * options.field_model.rms_T))
    if first.current is None:
        raise TableError(f"{options.method} needs current_A; instead received a record without it.")
    lasting = math.sqrt(max(1.0, MODEL_ERROR_TIME_S / dt))
    floor = white_sigma(first.current) / _current_to_field(options)
    floor = math.hypot(floor, lasting * options.systematics.reference_offset_T)
    relative = lasting * options.systematics.reference_gain
    return Noise(voltage, LinearSigma(floor, relative), max(FIRST_FIELD_SIGMA_T, 10.0 * floor))


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
