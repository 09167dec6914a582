"""Spectra of measured distances."""

import numpy as np
import pytest

from femfit.simulation.spectrum import amplitude_spectrum


def test_a_sine_shows_a_peak_of_its_amplitude_at_its_frequency():
    step = 0.5e-3
    time = step * np.arange(2000)
    record = 0.022 + 3e-5 * np.sin(2 * np.pi * 50.0 * time)[:, None]
    spectrum = amplitude_spectrum(record, step)
    peak = int(np.argmax(spectrum.amplitude_m))
    assert spectrum.frequency_Hz[peak] == pytest.approx(50.0)
    assert spectrum.amplitude_m[peak] == pytest.approx(3e-5, rel=2e-3)  # np.hanning is symmetric: 1/2000
    assert spectrum.frequency_Hz[-1] == pytest.approx(1000.0)


def test_white_noise_is_flat():
    noise = np.random.default_rng(0).normal(0.0, 1e-4, (1000, 200))
    amplitude = amplitude_spectrum(noise, 0.5e-3).amplitude_m[3:-3]
    halves = amplitude[: len(amplitude) // 2].mean(), amplitude[len(amplitude) // 2 :].mean()
    assert halves[0] == pytest.approx(halves[1], rel=0.02)  # 250 bins of 200 runs
