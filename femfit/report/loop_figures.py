"""Figures of the closed loop."""

from typing import TYPE_CHECKING

import numpy as np

from femfit.report.style import BLUE, GREEN, INK, MUTED, ORANGE, new_figure, styled
from femfit.simulation.study import SpectrumPair, StepSeries

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MM = 1e3
MICRO = 1e6
NAMES = {
    "backstepping": "backstepping",
    "pid": "PID",
    "direct": "direct measurement",
    "ukf": "UKF",
    "ekf": "EKF",
    "srukf": "square-root UKF",
    "ukf4": "UKF with four states",
    "ekf4": "EKF with four states",
    "srukf4": "square-root UKF with four states",
}
"""Controllers and observers as they are written."""


@styled
def steps_figure(series: StepSeries) -> "Figure":
    """Reference steps, direct measurement against filter.

    Returns
    -------
    Figure
        Distances, errors of both measurements, and the coil voltage; the noisy curves are rasterised.
    """
    figure = new_figure(5.0)
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(2.2, 1.3, 1.0))
    t, name = series.time_s, NAMES[series.observer]
    known = bool(np.isfinite(series.direct_m).any())
    if known:
        top.plot(t, MM * series.direct_m, color=ORANGE, linewidth=0.5, label="direct measurement", rasterized=True)
    top.plot(t, MM * series.estimated_m, color=BLUE, linewidth=1.3, label=name)
    top.plot(t, MM * series.true_m, color=INK, linewidth=0.9, dashes=(4, 2), label="true distance")
    top.plot(t, MM * series.reference_m, color=GREEN, linewidth=0.9, label="reference")
    top.set_ylabel("distance d (mm)")
    if known:
        middle.plot(t, MM * (series.direct_m - series.true_m), color=ORANGE, linewidth=0.5, rasterized=True)
    middle.plot(t, MM * (series.estimated_m - series.true_m), color=BLUE, linewidth=0.9, rasterized=True)
    middle.set_ylabel("measured\n− true (mm)")
    bottom.plot(t, series.voltage_V, color=MUTED, linewidth=0.6, rasterized=True)
    bottom.set(ylabel="coil\nvoltage (V)", xlabel="time (s)")
    figure.align_ylabels()
    figure.legend(*top.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


@styled
def spectrum_figure(pair: SpectrumPair) -> "Figure":
    """Spectra of the direct measurement and of the filter, at rest."""
    figure = new_figure(2.8)
    axes = figure.subplots()
    for spectrum, colour, label in ((pair.direct, ORANGE, "direct measurement"), (pair.filtered, BLUE, "UKF")):
        keep = spectrum.frequency_Hz > 0.0
        axes.loglog(
            spectrum.frequency_Hz[keep], MICRO * spectrum.amplitude_m[keep], color=colour, linewidth=1.1, label=label
        )
    axes.set(xlabel="frequency (Hz)", ylabel="amplitude (µm)")
    axes.legend(loc="lower left")
    return figure
