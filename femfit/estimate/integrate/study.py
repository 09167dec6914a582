"""Tables 1 to 3 of the paper from the synthetic experiment, beside the printed figures.

What the tables depend on is put in (:class:`ExperimentInputs`): the offset's mean and wander set Table 1 and the drift
of the first three rows of Table 2; offset, Hall probe and supply, as they wander, set its last two rows; the distance
of the field at the top from 320 A / g sets Table 3's last row. Found are the filters' lags and variances.

References
----------
P. Arpaia et al., Sensors 22 (2022) 182, Tables 1 to 3.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.estimate.integrate.experiment import PAPER_RAMP_RATES, Experiment, ExperimentInputs, synthesise
from femfit.estimate.integrate.field_block import FieldBlock
from femfit.estimate.integrate.indicators import global_drift, total_uncertainty
from femfit.estimate.integrate.methods import (
    AnyIntegrator,
    IntegrationOptions,
    Method,
    integrate_blocks,
    make_integrator,
)
from femfit.estimate.integrate.uncertainty import PAPER_COIL
from femfit.model.field_of_current import FieldModel

SETTLING = 30.0
"""Seconds after the first flat-top's begin at which (17) starts here, and plateau errors are taken."""

PAPER_METHODS: tuple[Method, ...] = ("trapezoid", "ffa1", "ffa2", "cs1", "cs2")

_CYCLES: Mapping[float, int] = {3.2: 3, 32.0: 4, 100.0: 4}

# Initial transient of a filter, s, which Table 1 leaves out.
_ACQUIRED = 5.0


@dataclass(frozen=True)
class Figures:
    """What one method gives at one ramp rate.

    Parameters
    ----------
    ramp_rate : float
        A/s.
    method : str
        Its name.
    offset_mean, offset_range : float, (float, float)
        Table 1, V; averaged over a second.
    drift : float
        Table 2, delta_G after settling, 1/s.
    uncertainty_end : float
        Table 3, sigma_B at the last flat-top's end with k = 2, T.
    plateau_rms : float
        True rms error on settled flat-tops, T; not in the paper, whose truth is not known.
    """

    ramp_rate: float
    method: Method
    offset_mean: float
    offset_range: tuple[float, float]
    drift: float
    uncertainty_end: float
    plateau_rms: float


@dataclass(frozen=True)
class Printed:
    """A method's figures in the paper at 3.2, 32 and 100 A/s; None where it has none.

    Parameters
    ----------
    offset_mean : tuple of float, or None
        Table 1, V.
    offset_range : tuple of (float, float), or None
        Table 1, V.
    drift : tuple of float
        Table 2, 1/s, from the first flat-top's beginning.
    uncertainty_end : tuple of float
        Table 3, T.
    """

    offset_mean: tuple[float, float, float] | None
    offset_range: tuple[tuple[float, float], ...] | None
    drift: tuple[float, float, float]
    uncertainty_end: tuple[float, float, float]


PAPER: Mapping[Method, Printed] = {
    "trapezoid": Printed(None, None, (112.14e-6, 119.98e-6, 59.90e-6), (194.48e-3, 104.23e-3, 60.34e-3)),
    "ffa1": Printed((3.3e-6, 6.8e-6, 6.8e-6), None, (59.25e-6, 8.03e-6, 53.02e-6), (100.25e-3, 9.38e-3, 25.97e-3)),
    "ffa2": Printed(
        (6.0e-6, 6.9e-6, 4.6e-6),
        ((-1e-6, 14e-6), (1e-6, 16e-6), (-1e-6, 24e-6)),
        (55.47e-6, 5.05e-6, 2.95e-6),
        (37.57e-3, 6.53e-3, 5.53e-3),
    ),
    "cs1": Printed(
        (6.9e-6, 7.2e-6, 4.4e-6),
        ((-1e-6, 19e-6), (-3e-6, 17e-6), (-11e-6, 24e-6)),
        (0.03e-6, 0.04e-6, 0.03e-6),
        (65e-6, 65e-6, 65e-6),
    ),
    "cs2": Printed(
        (6.9e-6, 7.2e-6, 4.4e-6),
        ((-29e-6, 122e-6), (-129e-6, 412e-6), (-250e-6, 496e-6)),
        (0.02e-6, 0.03e-6, 0.08e-6),
        (667e-6, 533e-6, 482e-6),
    ),
}
"""Tables 1 to 3 as printed."""


def paper_study(
    rng: np.random.Generator,
    sample_rate: float = 1000.0,
    ramp_rates: Sequence[float] = PAPER_RAMP_RATES,
    field_model: FieldModel | None = None,
) -> tuple[Figures, ...]:
    """Run every method over the synthetic experiment.

    The paper's methods weigh to the letter (``paper``), cs1-offset and cs2-identified as ``gum``.

    Parameters
    ----------
    rng : numpy.random.Generator
        Of the records.
    sample_rate : float
        Hz; posterior variances and time constants do not depend on it.
    ramp_rates : sequence of float
        A/s.
    field_model : FieldModel or None
        For cs2-identified, which is left out where None.

    Returns
    -------
    tuple of Figures
        By ramp rate, then method.
    """
    return tuple(
        figures
        for ramp_rate in ramp_rates
        for figures in experiment_figures(
            synthesise(
                ExperimentInputs(
                    ramp_rate=ramp_rate, amplitudes=(320.0,) * _CYCLES.get(ramp_rate, 3), sample_rate=sample_rate
                ),
                rng,
            ),
            field_model,
        )
    )


def experiment_figures(experiment: Experiment, field_model: FieldModel | None = None) -> tuple[Figures, ...]:
    """Every method's figures on one experiment.

    Parameters
    ----------
    experiment : Experiment
        With its zero reading.
    field_model : FieldModel or None
        For cs2-identified, which is left out where None.

    Returns
    -------
    tuple of Figures
        The paper's five, cs1-offset, and cs2-identified.
    """
    measured = experiment.after_zero_reading()
    results: dict[Method, FieldBlock] = {}
    sources: dict[Method, Experiment] = {}
    extra: tuple[Method, ...] = ("cs1-offset",) if field_model is None else ("cs1-offset", "cs2-identified")
    for method in (*PAPER_METHODS, *extra):
        sources[method] = source = experiment if method == "ffa1" else measured
        ((_, results[method]),) = integrate_blocks(_integrator(method, source, field_model), [source.record])
    return tuple(_figures(method, sources[method], block, results["cs1"]) for method, block in results.items())


def _integrator(method: Method, source: Experiment, field_model: FieldModel | None) -> AnyIntegrator:
    inputs = source.inputs
    starts = {"cs2": 0.0, "cs1-offset": None, "cs2-identified": None}
    options = IntegrationOptions(
        method,
        PAPER_COIL,
        treatment="paper" if method in PAPER_METHODS else "gum",
        initial_field=starts.get(method, inputs.remanence),
        zero_reading=inputs.zero_reading,
        field_model=field_model,
    )
    return make_integrator(options, source.record)


def _figures(method: Method, source: Experiment, block: FieldBlock, reference: FieldBlock) -> Figures:
    first, last = source.flat_tops[0], source.flat_tops[-1]
    drift = global_drift(block.time, block.field, first, last, SETTLING)
    end = int(np.searchsorted(block.time, last[1])) - 1
    same = int(np.searchsorted(reference.time, last[1])) - 1
    total = total_uncertainty(float(block.variance[end]), float(block.field[end]), float(reference.field[same]))
    live = block.offset[block.time > block.time[0] + max(_ACQUIRED, source.inputs.zero_reading * (method == "ffa1"))]
    return Figures(
        source.inputs.ramp_rate,
        method,
        float(live.mean()),
        (float(live.min()), float(live.max())),
        drift,
        total,
        plateau_rms(source, block.time, block.field),
    )


def plateau_rms(source: Experiment, time: FloatArray, field: FloatArray, settling: float = SETTLING) -> float:
    """Rms of the true error over the settled parts of all flat-tops.

    Parameters
    ----------
    source : Experiment
        With the truth, sample by sample.
    time, field : array, shape (n,)
        Of the same samples, s and T.
    settling : float
        Left out after each flat-top's begin, s.

    Returns
    -------
    float
        In T.
    """
    settled = np.any([(time > begin + settling) & (time < end) for begin, end in source.flat_tops], axis=0)
    return float(np.sqrt(np.mean(np.square((field - source.field)[settled]))))


def study_lines(study: Sequence[Figures]) -> list[str]:
    """The three tables as text, each figure beside the paper's.

    Parameters
    ----------
    study : sequence of Figures
        Of :func:`paper_study`.

    Returns
    -------
    list of str
        Lines.
    """
    lines = [
        "here / paper; offset in uV (mean [range]), drift in ppm/s, sigma_B,end (k = 2) and true plateau rms in uT",
        f"{'A/s':>5} {'method':<15} {'offset':<38} {'drift':<18} {'sigma_B,end':<22} plateau rms",
    ]
    for row in study:
        printed = PAPER.get(row.method)
        place = PAPER_RAMP_RATES.index(row.ramp_rate) if row.ramp_rate in PAPER_RAMP_RATES else None
        offset = f"{1e6 * row.offset_mean:.1f} [{1e6 * row.offset_range[0]:.0f}, {1e6 * row.offset_range[1]:.0f}]"
        drift, total = f"{1e6 * row.drift:.3g}", f"{1e6 * row.uncertainty_end:.4g}"
        if printed is not None and place is not None:
            if printed.offset_mean is not None:
                offset += f" / {1e6 * printed.offset_mean[place]:.1f}"
            if printed.offset_range is not None:
                low, high = printed.offset_range[place]
                offset += f" [{1e6 * low:.0f}, {1e6 * high:.0f}]"
            drift += f" / {1e6 * printed.drift[place]:.3g}"
            total += f" / {1e6 * printed.uncertainty_end[place]:.4g}"
        lines.append(
            f"{row.ramp_rate:>5g} {row.method:<15} {offset:<38} {drift:<18} {total:<22} {1e6 * row.plateau_rms:.3g}"
        )
    return lines
