"""What is known of the sensors: noise, which averages out, and systematics, which do not.

White noise is weighed by the filters; gains and offsets, which are one unknown number for a whole record, are carried
through them as sensitivities. JCGM 100:2008 (GUM), 4.2 and 4.3 (type A and B), 5.1 (combination).

Last stand the constants that decide something in this room. Each has its kind: derived (from what), conventional,
calibrated (on what), or chosen (a judgement, with what it means).
"""

import math
from dataclasses import dataclass

import numpy as np

from femfit.core.errors import TableError
from femfit.core.numerics import FloatArray
from femfit.core.text import counted

# Second differences of white noise have six times its variance; the median of |normal| is 0.6745 sigma.
_MEDIAN_TO_SIGMA = 1.0 / (0.6745 * math.sqrt(6.0))


@dataclass(frozen=True)
class SensingCoil:
    """A coil with a known total area in m2; 1 makes every field a flux linkage in Wb."""

    area_m2: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.area_m2) and self.area_m2 > 0.0):
            raise TableError(
                f"A coil's total area must be > 0 m2; instead received {self.area_m2:g}. Give turns x area of a turn; "
                "for a coil wound the other way, change the sign of its voltage."
            )


@dataclass(frozen=True)
class LinearSigma:
    """A standard deviation floor + relative |value|, as data sheets give it."""

    floor: float
    relative: float = 0.0

    def variance(self, value: FloatArray) -> FloatArray:
        """Squared standard deviation of each value."""
        return np.asarray(np.square(self.floor + self.relative * np.abs(value)))


@dataclass(frozen=True)
class Noise:
    """What the filter weighs."""

    voltage: LinearSigma  # White noise of each sample, V
    # White noise of each Hall reading, T; of a current's field its error, which lasts for about a second
    reference: LinearSigma
    initial_T: float  # Standard uncertainty of the field before the first sample


@dataclass(frozen=True)
class Systematics:
    """Standard uncertainties of what stays the same through a record; gains are relative."""

    coil_gain: float = 0.0
    reference_gain: float = 0.0
    reference_offset_T: float = 0.0
    offset_voltage_V: float = 0.0


@dataclass(frozen=True, eq=False)
class Responses:
    """How the estimate answers to what is systematic; a linear filter answers to each as to a signal of its own."""

    # The part of the field, in T, that came from the coil and from the reference: dB per relative gain error
    # shape (n,)
    coil: FloatArray
    reference: FloatArray
    reference_unit: FloatArray  # dB per tesla of reference offset, between 0 and 1; shape (n,)
    voltage_unit: FloatArray  # dB per volt of constant offset voltage, T/V; shape (n,)

    def parts(self, systematics: Systematics) -> dict[str, FloatArray]:
        """Standard uncertainty in T that each source brings, shape (n,)."""
        return {
            "coil_gain": np.abs(self.coil) * systematics.coil_gain,
            "reference_gain": np.abs(self.reference) * systematics.reference_gain,
            "reference_offset": np.abs(self.reference_unit) * systematics.reference_offset_T,
            "offset_voltage": np.abs(self.voltage_unit) * systematics.offset_voltage_V,
        }


@dataclass(frozen=True, eq=False)
class FieldBlock:
    """The integrated field, a value for each sample of a coil block, each an array of shape (n,)."""

    time: FloatArray
    field: FloatArray  # B in T (a flux linkage in Wb where the coil's area is 1)
    variance: FloatArray  # Variance of white noise, in T^2
    offset: FloatArray  # Estimated offset voltage in V
    # Reference minus prediction where a reading was used, NaN elsewhere; T and T^2
    innovation: FloatArray
    innovation_variance: FloatArray
    responses: Responses

    def sigma(self, systematics: Systematics) -> FloatArray:
        """Combined standard uncertainty in T of noise and independent systematics (GUM 5.1.2)."""
        parts = self.responses.parts(systematics).values()
        return np.asarray(np.sqrt(self.variance + sum(np.square(part) for part in parts)))


def white_sigma(values: FloatArray) -> float:
    """Standard deviation of white noise on a slow signal, from second differences; NaN are left out.

    It is at least 1e-9 of the largest value, so that noiseless data can be weighed.
    """
    finite = values[np.isfinite(values)]
    if len(finite) < 3:
        raise TableError(
            f"Noise cannot be evaluated from {counted(len(finite), 'reading')} in the first block; give at least 3."
        )
    bends = np.abs(np.diff(finite, 2))
    # The median of coarsely quantised readings may be 0; their mean is not.
    centre = float(np.median(bends)) or 0.845 * float(np.mean(bends))
    return max(centre * _MEDIAN_TO_SIGMA, 1e-9 * float(np.abs(finite).max()), 1e-15)


# ---- constants

GAP = 1.5
"""Two samples further apart than this many sample times have a gap between them. Derived: 2 is one lost sample, and
half a sample time is left for jitter."""

# ---- what may be wrong with a record

CLIPPED_RUN = 4
"""So many equal samples in a row at the largest |voltage| are clipped where noise above a converter's steps, or a rise
of two samples before, leads beyond it. Chosen: two neighbours are equal by chance, four at the very top hardly ever."""

CLIPPED_LEVELS = 16
"""A record of fewer different voltages is quiet, or computed. Chosen."""

STUCK_TIME_S = 0.05
"""For so long a living instrument never repeats a reading exactly. Chosen: its noise is above its resolution."""

STUCK_SHARE = 0.01
"""A reading is stuck if coil and probe meanwhile saw the field move differently by this share of all that they saw in
the record. Chosen: far above a probe's noise, far below a ramp."""

STUCK_OFFSET_V = 60e-6
"""What a coil makes of so much is no motion of the field. Derived: three standard deviations of an offset voltage that
nothing took off, as in :data:`FIRST_OFFSET_SIGMA_V`."""

GAIN_TOLERANCE = 0.05
"""Relative disagreement of coil and reference over the ramps that is put down to a wrong area or gain. Chosen: areas
are known to a per cent, wrong turns or wrong units are off by more."""

AGREEMENT = 0.8
"""Squared correlation from which the changes that coil and reference see are the same thing. Chosen."""

COMPARED_S = 0.1
"""Time over which changes of coil and reference are compared: long enough that white noise is small beside a ramp.
Chosen."""

INNOVATIONS_AVERAGED = 50
INNOVATION_BAND = 9.0
"""Mean square of 50 normalised innovations (1 in a true filter) beyond which they have left their band. Derived: its
standard deviation is sqrt(2 / 50) = 0.2, so this is 40 of them; a reference that is wrong by 3 sigma reaches it."""

# ---- what is assumed where the user says nothing

OFFSET_SIGMA_V = {"trapezoid": 20e-6, "ffa1": 5e-6, "ffa2": 5e-6}
"""Standard uncertainty of the offset voltage that a method leaves. Chosen: 20 uV for an amplifier's own offset, 5 uV
for what wanders after it was measured; the filters estimate it."""

FIRST_OFFSET_SIGMA_V = 20e-6
"""Standard deviation of the offset voltage when a record begins. Chosen: an amplifier's own offset."""

OFFSET_WANDER_V = 1e-6
"""How far the offset voltage walks in a second, V/sqrt(s), for the filters that estimate it. Chosen: a few microvolts
in ten seconds, as instrumentation amplifiers do."""

FIRST_FIELD_SIGMA_T = 3e-3
"""Uncertainty of the first field where a current is the reference. Chosen: the remanence of a core that was switched
off."""

MODEL_ERROR_TIME_S = 1.0
"""For so long an error of the current's field counts as noise; weighed as lasting longer, the offset would drift after
it. Chosen: the scale of a ramp."""

SETTLING_S = 1.0
"""After each ramp, before ffa2 takes the mean voltage for the offset. Chosen: eddy currents of a small actuator decay
in milliseconds; a magnet with a solid yoke needs tens of seconds."""

STILL_A, STILL_V = 0.1, 1e-4
"""A current, or where there is none a mean voltage, that moves by less in a second is on a plateau. Chosen."""
