"""Amplitudes of noise over its frequency."""

import numpy as np

from femfit.core.arrays import FloatArray


def amplitude_spectrum(distance: FloatArray) -> FloatArray:
    """One-sided amplitudes |X_k| 2 / sum(window) of Hann-windowed records of shape (samples, runs) without their means.

    Root mean square over the runs (F. J. Harris, Proc. IEEE 66 (1978) 51: windows).
    """
    window = np.hanning(len(distance))[:, None]
    transform = np.abs(np.fft.rfft(window * (distance - distance.mean(axis=0)), axis=0)) * 2.0 / window.sum()
    return np.asarray(np.sqrt(np.mean(transform**2, axis=1)))
