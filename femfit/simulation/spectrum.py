"""Amplitude spectrum of a measured distance, as in Figures 17 and 18.

One-sided amplitudes |X_k| 2 / sum(window) of a Hann-windowed record without its mean, root-mean-square over the runs,
so that a sine of amplitude a shows a peak of height a.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504, Figures 17 and 18.
F. J. Harris, Proc. IEEE 66 (1978) 51: windows.
"""

from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Amplitudes over frequency.

    Parameters
    ----------
    frequency_Hz, amplitude_m : array, shape (bins,)
        From zero to half the sampling rate.
    """

    frequency_Hz: FloatArray
    amplitude_m: FloatArray


def amplitude_spectrum(distance: FloatArray, sample_time: float) -> Spectrum:
    """Spectrum of records at rest.

    Parameters
    ----------
    distance : array, shape (samples, runs)
        In m.
    """
    window = np.hanning(len(distance))[:, None]
    transform = np.abs(np.fft.rfft(window * (distance - distance.mean(axis=0)), axis=0)) * 2.0 / window.sum()
    amplitude = np.sqrt(np.mean(transform**2, axis=1))
    return Spectrum(np.fft.rfftfreq(len(distance), sample_time).astype(np.float64), np.asarray(amplitude))
