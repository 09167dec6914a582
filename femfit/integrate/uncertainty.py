"""What is known of the sensors: noise, which averages out, and systematics, which do not.

The *paper* treatment takes every term as white noise of each sample, as (11) does: its posterior variance is then a
filter's covariance, not an uncertainty budget. The *gum* treatment keeps white noise in the filter and carries gains
and offsets, which are one unknown number for a whole record, through the filter as sensitivities.

References
----------
P. Arpaia et al., Sensors 22 (2022) 182, eq. (11), sections 2.4 and 2.5.
JCGM 100:2008 (GUM), 4.2 and 4.3 (type A and B), 5.1 (combination), 6.2 (coverage factor).
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.core.errors import TableError

PAPER_SAMPLE_RATE = 204.8e3
"""Of the paper's converter in Hz; not printed there, but it makes 2 sqrt(P) = 65 uT of Table 3."""

Reference = Literal["hall", "current"]


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


PAPER_COIL = SensingCoil(0.059394, 2.29e-6)
"""161 turns on 16 layers, calibrated by flipping; section 2.2."""

PAPER_CURRENT_TO_FIELD = 316.0
"""g in A/T, section 2.5."""


@dataclass(frozen=True)
class LinearSigma:
    """A standard deviation floor + relative |value|, as data sheets give it."""

    floor: float
    relative: float = 0.0

    def variance(self, value: FloatArray) -> FloatArray:
        """Squared standard deviation of each value."""
        return np.asarray(np.square(self.floor + self.relative * np.abs(value)))

    def scaled(self, factor: float) -> "LinearSigma":
        """Times a factor."""
        return LinearSigma(self.floor * factor, self.relative * factor)


@dataclass(frozen=True)
class Noise:
    """White noise of each sample, which the filter weighs.

    Parameters
    ----------
    reference : LinearSigma
        Of a reference reading (Hall probe, or field from the current), T.
    initial_T : float
        Standard uncertainty of the field before the first sample.
    area_is_noise : bool
        Whether (11)'s area term counts as white noise (the paper), or is left to the systematics.
    shared_samples : bool
        Whether two trapezoids share a sample's noise, so that the increments of n samples have the variance of n
        samples. (11) takes them as independent and arrives at half of it.
    """

    voltage: LinearSigma
    reference: LinearSigma
    initial_T: float
    area_is_noise: bool = False
    shared_samples: bool = True


@dataclass(frozen=True)
class Systematics:
    """Standard uncertainties of what stays the same through a record (type B, or type A of a calibration).

    Parameters
    ----------
    coil_gain : float
        Relative: area and converter gain together.
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


def paper_noise(reference: Reference, sample_rate: float = PAPER_SAMPLE_RATE) -> Noise:
    """The paper's literal treatment: data sheet limits and gains as white noise of every sample.

    Its sigmas belong to 204.8 kS/s. At another rate they are scaled to the same spectral density, sigma^2
    proportional to the rate, which leaves posterior variance and time constant as they are.

    Returns
    -------
    Noise
        Values inside sigma are in V for the voltage, in T for the Hall probe and in mT for I/g: the reading under which
        Table 3 follows.
    """
    factor = math.sqrt(sample_rate / PAPER_SAMPLE_RATE)
    hall, current = LinearSigma(9.02e-3, 3e-6), LinearSigma(1.8e-5, 6e-3)
    return Noise(
        voltage=LinearSigma(2.05e-3, 3e-6).scaled(factor),
        reference=(hall if reference == "hall" else current).scaled(factor),
        initial_T=9.02e-3 if reference == "hall" else 1.8e-5,
        area_is_noise=True,
        shared_samples=False,
    )


def increment_variance(noise: Noise, coil: SensingCoil, voltage: FloatArray, dt: FloatArray) -> FloatArray:
    """Variance of B_k - B_(k-1): (11), with the terms that the treatment takes as noise.

    Parameters
    ----------
    voltage : array, shape (n + 1,)
        v_0 .. v_n.
    dt : array, shape (n,)
        Between them, s.

    Returns
    -------
    array, shape (n,)
        In T^2.
    """
    variance = noise.voltage.variance(voltage)
    pair = variance[1:] + variance[:-1]
    if noise.shared_samples:
        pair *= 2.0
    if noise.area_is_noise and coil.area_sigma_m2 > 0.0:
        pair += (coil.area_sigma_m2 / coil.area_m2) ** 2 * np.square(voltage[1:] + voltage[:-1])
    return np.asarray(np.square(dt / (2.0 * coil.area_m2)) * pair)
