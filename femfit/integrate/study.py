"""Tables 1 to 3 of the paper from the synthetic experiment, beside the printed figures.

What the tables depend on is put in (:class:`ExperimentInputs`): the offset's mean and wander set Table 1 and the drift
of the first three rows of Table 2; offset, Hall probe and supply, as they wander, set its last two rows; the distance
of the field at the top from 320 A / g sets Table 3's last row. Found are the filters' lags and variances.

References
----------
P. Arpaia et al., Sensors 22 (2022) 182, Tables 1 to 3.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from femfit.core.arrays import BoolArray, FloatArray
from femfit.integrate.experiment import PAPER_RAMP_RATES, Experiment, ExperimentInputs, make_course
from femfit.integrate.field_block import FieldBlock
from femfit.integrate.indicators import AVERAGE, global_drift, total_uncertainty
from femfit.integrate.methods import (
    AnyIntegrator,
    IntegrationOptions,
    Method,
    integrate_blocks,
    make_integrator,
)
from femfit.integrate.paper_tables import PAPER
from femfit.integrate.uncertainty import PAPER_COIL
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
    sample_rate : float
        Hz; posterior variances and time constants do not depend on it.
    field_model : FieldModel or None
        For cs2-identified, which is left out where None.
    """
    figures: list[Figures] = []
    for ramp_rate in ramp_rates:
        # Apart, so that another sample rate meets the same offsets, supply and probe.
        wander, noise = rng.spawn(2)
        course = make_course(paper_inputs(ramp_rate, sample_rate), wander)
        figures += experiment_figures([course.piece(0, course.samples, noise)], field_model)
    return tuple(figures)


def paper_inputs(ramp_rate: float, sample_rate: float = 1000.0) -> ExperimentInputs:
    """The experiment at one of the paper's ramp rates, with as many cycles as its Figure 7 shows."""
    return ExperimentInputs(
        ramp_rate=ramp_rate, amplitudes=(320.0,) * _CYCLES.get(ramp_rate, 3), sample_rate=sample_rate
    )


def experiment_figures(pieces: Iterable[Experiment], field_model: FieldModel | None = None) -> tuple[Figures, ...]:
    """Every method's figures on one experiment.

    Parameters
    ----------
    pieces : iterable of Experiment
        Of one experiment in order, with its zero reading: the whole of it, or as much at a time as fits the memory.
        The zero reading ends where a piece ends, or at least three samples before.
    field_model : FieldModel or None
        For cs2-identified, which is left out where None.

    Returns
    -------
    tuple of Figures
        The paper's five, cs1-offset, and cs2-identified.
    """
    extra: tuple[Method, ...] = ("cs1-offset",) if field_model is None else ("cs1-offset", "cs2-identified")
    running: dict[Method, tuple[AnyIntegrator, Any]] = {}
    parts: dict[Method, list[_Part]] = {method: [] for method in (*PAPER_METHODS, *extra)}
    for piece in pieces:
        inputs, flat_tops, measured = piece.inputs, piece.flat_tops, piece.after_zero_reading()
        for method, found in parts.items():
            source = piece if method == "ffa1" else measured
            if len(source.record) == 0:
                continue
            if method not in running:
                integrator = _integrator(method, source, field_model)
                running[method] = (integrator, integrator.start())
            integrator, state = running[method]
            state, block = integrator.advance(state, source.record)
            running[method] = (integrator, state)
            found.append(_part(method, source, block))
    reference = _end(parts["cs1"], flat_tops)
    return tuple(_figures(method, inputs.ramp_rate, found, flat_tops, reference) for method, found in parts.items())


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


def experiment_fields(
    experiment: Experiment, methods: Sequence[Method] = PAPER_METHODS, field_model: FieldModel | None = None
) -> dict[Method, FieldBlock]:
    """What each method makes of a whole experiment, for pictures.

    Parameters
    ----------
    experiment : Experiment
        All of it, with its zero reading.

    Returns
    -------
    dict of FieldBlock
        By method; ffa1's begins with the zero reading, the others' after it.
    """
    measured = experiment.after_zero_reading()
    found: dict[Method, FieldBlock] = {}
    for method in methods:
        source = experiment if method == "ffa1" else measured
        ((_, found[method]),) = integrate_blocks(_integrator(method, source, field_model), [source.record])
    return found


@dataclass(frozen=True, eq=False)
class _Part:
    """What the tables need of a piece: samples near the ends of (17), offsets, and squared errors on flat-tops."""

    near: FloatArray  # time, field and variance, shape (3, n)
    offset: tuple[float, float, float, int]  # smallest, largest, sum, samples
    squares: tuple[float, int]  # sum, samples


def _part(method: Method, source: Experiment, block: FieldBlock) -> _Part:
    time, zero = block.time, source.inputs.zero_reading
    begin, end = source.flat_tops[0][0] + SETTLING, source.flat_tops[-1][1]
    near = (np.abs(time - begin) <= 2.0 * AVERAGE) | (np.abs(time - end) <= 2.0 * AVERAGE)
    live = block.offset[time > (max(_ACQUIRED, zero) if method == "ffa1" else zero + _ACQUIRED)]
    error = (block.field - source.field)[_settled(source, time, SETTLING)]
    return _Part(
        np.stack([time[near], block.field[near], block.variance[near]]),
        (float(live.min(initial=np.inf)), float(live.max(initial=-np.inf)), float(live.sum()), len(live)),
        (float(error @ error), len(error)),
    )


def _end(parts: Sequence[_Part], flat_tops: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Field and variance at the last flat-top's end."""
    time, field, variance = np.concatenate([part.near for part in parts], axis=1)
    end = int(np.searchsorted(time, flat_tops[-1][1])) - 1
    return float(field[end]), float(variance[end])


def _figures(
    method: Method,
    ramp_rate: float,
    parts: Sequence[_Part],
    flat_tops: Sequence[tuple[float, float]],
    reference: tuple[float, float],
) -> Figures:
    time, field, _ = np.concatenate([part.near for part in parts], axis=1)
    end_field, end_variance = _end(parts, flat_tops)
    lowest, highest, total, count = zip(*(part.offset for part in parts), strict=True)
    squares, settled = np.sum([part.squares for part in parts], axis=0)
    return Figures(
        ramp_rate,
        method,
        sum(total) / sum(count),
        (min(lowest), max(highest)),
        global_drift(time, field, flat_tops[0], flat_tops[-1], SETTLING),
        total_uncertainty(end_variance, end_field, reference[0]),
        float(np.sqrt(squares / settled)),
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
    """
    return float(np.sqrt(np.mean(np.square((field - source.field)[_settled(source, time, settling)]))))


def _settled(source: Experiment, time: FloatArray, settling: float) -> BoolArray:
    """Samples on settled parts of flat-tops."""
    return np.asarray(np.any([(time > begin + settling) & (time < end) for begin, end in source.flat_tops], axis=0))


def study_lines(study: Sequence[Figures]) -> list[str]:
    """The three tables as text, each figure beside the paper's."""
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
