"""What is known of the sensors: noise, which averages out, and systematics, which do not.

White noise is weighed by the filters; gains and offsets, which are one unknown number for a whole record, are carried
through them as sensitivities.

References
----------
P. Arpaia et al., Sensors 22 (2022) 182, eq. (11).
JCGM 100:2008 (GUM), 4.2 and 4.3 (type A and B), 5.1 (combination), 6.2 (coverage factor).
"""

import math
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import TableError


@dataclass(frozen=True)
class SensingCoil:
    """A coil with a known total area.

    Parameters
    ----------
    area_m2 : float
        Total area, > 0; 1 makes every field a flux linkage in Wb.
    """

    area_m2: float
    area_sigma_m2: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.area_m2) and self.area_m2 > 0.0):
            raise TableError(
                f"A coil's total area must be > 0 m2; instead received {self.area_m2:g}. Give turns x area of a turn; "
                "for a coil wound the other way, change the sign of its voltage."
            )
        if not (math.isfinite(self.area_sigma_m2) and self.area_sigma_m2 >= 0.0):
            raise TableError(f"The area's uncertainty must be >= 0 m2; instead received {self.area_sigma_m2:g}.")


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
    """White noise of each sample, which the filter weighs.

    Parameters
    ----------
    reference : LinearSigma
        Of a reference reading (Hall probe, or field from the current), T.
    initial_T : float
        Standard uncertainty of the field before the first sample.
    """

    voltage: LinearSigma
    reference: LinearSigma
    initial_T: float


@dataclass(frozen=True)
class Systematics:
    """Standard uncertainties of what stays the same through a record (type B, or type A of a calibration).

    Parameters
    ----------
    reference_gain : float
        Relative: Hall sensitivity, or current transducer with current-to-field ratio.
    reference_offset_T : float
        Of the reference's zero, its model's error included.
    offset_voltage_V : float
        Of the offset voltage that a method does not estimate itself, or of its estimate.
    """

    coil_gain: float = 0.0
    reference_gain: float = 0.0
    reference_offset_T: float = 0.0
    offset_voltage_V: float = 0.0


@dataclass(frozen=True, eq=False)
class Responses:
    """How the estimate answers to what is systematic; a linear filter answers to each as to a signal of its own.

    Parameters
    ----------
    coil, reference : array, shape (n,)
        The part of the field, in T, that came from the coil and from the reference: dB per relative gain error.
    reference_unit : array, shape (n,)
        dB per tesla of reference offset, between 0 and 1.
    voltage_unit : array, shape (n,)
        dB per volt of constant offset voltage, T/V.
    """

    coil: FloatArray
    reference: FloatArray
    reference_unit: FloatArray
    voltage_unit: FloatArray

    def variance(self, systematics: Systematics) -> FloatArray:
        """Combined variance of independent systematics in T^2, shape (n,) (GUM 5.1.2)."""
        parts = self.parts(systematics)
        return np.asarray(sum(np.square(part) for part in parts.values()))

    def parts(self, systematics: Systematics) -> dict[str, FloatArray]:
        """Standard uncertainty in T that each source brings, shape (n,)."""
        return {
            "coil_gain": np.abs(self.coil) * systematics.coil_gain,
            "reference_gain": np.abs(self.reference) * systematics.reference_gain,
            "reference_offset": np.abs(self.reference_unit) * systematics.reference_offset_T,
            "offset_voltage": np.abs(self.voltage_unit) * systematics.offset_voltage_V,
        }


def increment_variance(noise: Noise, coil: SensingCoil, voltage: FloatArray, dt: FloatArray) -> FloatArray:
    """Variance of B_k - B_(k-1) in T^2: the voltage's part of (11), twice.

    Two trapezoids share a sample's noise, so that the increments of n samples have the variance of n samples; (11)
    takes them as independent and arrives at half of it.

    Parameters
    ----------
    dt : array, shape (n,)
        Between them, s.
    """
    variance = noise.voltage.variance(voltage)
    return np.asarray(np.square(dt / coil.area_m2) * (variance[1:] + variance[:-1]) / 2.0)
