"""What is known of the sensors: noise, which averages out, and systematics, which do not.

White noise is weighed by the filters; gains and offsets, which are one unknown number for a whole record, are carried
through them as sensitivities. JCGM 100:2008 (GUM), 4.2 and 4.3 (type A and B), 5.1 (combination).
"""

import math
from dataclasses import dataclass

import numpy as np

from femfit.core.errors import TableError
from femfit.core.numerics import LARGEST, NORMAL_MEDIAN, FloatArray
from femfit.core.text import counted

# Second differences of white noise have six times its variance
_MEDIAN_TO_SIGMA = 1.0 / (NORMAL_MEDIAN * math.sqrt(6.0))


@dataclass(frozen=True)
class SensingCoil:
    """A coil with a known total area in m2; 1 makes every field a flux linkage in Wb."""

    area_m2: float

    def __post_init__(self) -> None:
        if not 1.0 / LARGEST <= self.area_m2 < LARGEST:
            raise TableError(
                f"A coil's total area must be > 0 m2, from {1.0 / LARGEST:g}; instead received {self.area_m2:g}. Give "
                "turns x area of a turn; for a coil wound the other way, change the sign of its voltage."
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
        return np.asarray(np.sqrt(self.variance + sum(np.square(share) for share in parts)))


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
