"""The paper's coil and converter, and its literal treatment: data sheet limits and gains as white noise of a sample.

References
----------
P. Arpaia et al., Sensors 22 (2022) 182, eq. (11), sections 2.2, 2.4 and 2.5.
"""

import math

from femfit.integrate.uncertainty import LinearSigma, Noise, SensingCoil

PAPER_SAMPLE_RATE = 204.8e3
"""Of the paper's converter in Hz; not printed there, but it makes 2 sqrt(P) = 65 uT of Table 3."""

PAPER_COIL = SensingCoil(0.059394)
"""161 turns on 16 layers, calibrated by flipping; section 2.2."""

PAPER_CURRENT_TO_FIELD = 316.0
"""g in A/T, section 2.5."""


def paper_noise(of_hall: bool, sample_rate: float = PAPER_SAMPLE_RATE) -> Noise:
    """White noise of each sample as the paper has it.

    Its sigmas belong to 204.8 kS/s. At another rate they are scaled to the same spectral density, sigma^2
    proportional to the rate, which leaves posterior variance and time constant as they are. Values inside sigma are in
    V for the voltage, in T for the Hall probe and in mT for I/g: the reading under which Table 3 follows. (11) takes
    the noise of neighbouring trapezoids as independent, which halves the voltage's variance; its area term is a
    ten-millionth of that and is left out.

    Parameters
    ----------
    of_hall : bool
        Whether the reference is the Hall probe (CS1), and not the current (CS2).
    """
    factor = math.sqrt(sample_rate / PAPER_SAMPLE_RATE)

    def scaled(floor: float, relative: float, by: float = factor) -> LinearSigma:
        return LinearSigma(floor * by, relative * by)

    reference = scaled(9.02e-3, 3e-6) if of_hall else scaled(1.8e-5, 6e-3)
    return Noise(scaled(2.05e-3, 3e-6, factor * math.sqrt(0.5)), reference, 9.02e-3 if of_hall else 1.8e-5)
