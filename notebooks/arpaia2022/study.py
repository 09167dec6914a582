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
from typing import Any, TypeAlias

import numpy as np

from arpaia2022.experiment import PAPER_RAMP_RATES, Experiment, ExperimentInputs
from arpaia2022.indicators import AVERAGE, global_drift, total_uncertainty
from arpaia2022.kalman import KalmanIntegrator
from arpaia2022.printed import PAPER
from arpaia2022.sensors import PAPER_COIL, PAPER_CURRENT_TO_FIELD, paper_noise
from femfit.core.numerics import BoolArray, FloatArray
from femfit.integrate.field_of_current import FieldModel
from femfit.integrate.integrator import Integrator
from femfit.integrate.methods import IntegrationOptions, make_integrator
from femfit.integrate.uncertainty import FieldBlock

SETTLING = 30.0
"""Seconds after the first flat-top's begin at which (17) starts here, and plateau errors are taken."""

EDDY_SETTLING = ((3.2, 32.0, 100.0), (20.0, 25.0, 30.0))
"""Ramp rates in A/s, and the seconds that FFA2 waits after each; section 3."""

AnyIntegrator: TypeAlias = Integrator | KalmanIntegrator

PAPER_METHODS: tuple[str, ...] = ("trapezoid", "ffa1", "ffa2", "cs1", "cs2")

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
    method: str
    offset_mean: float
    offset_range: tuple[float, float]
    drift: float
    uncertainty_end: float
    plateau_rms: float


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
    extra: tuple[str, ...] = ("cs1-offset",) if field_model is None else ("cs1-offset", "cs2-identified")
    running: dict[str, tuple[AnyIntegrator, Any]] = {}
    parts: dict[str, list[_Part]] = {method: [] for method in (*PAPER_METHODS, *extra)}
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


def _integrator(method: str, source: Experiment, field_model: FieldModel | None) -> AnyIntegrator:
    inputs = source.inputs
    noise = paper_noise(method == "cs1", inputs.sample_rate) if method in PAPER_METHODS else None
    if method in {"cs1", "cs2"}:
        ratio, start = (None, inputs.remanence) if method == "cs1" else (PAPER_CURRENT_TO_FIELD, 0.0)
        return KalmanIntegrator(PAPER_COIL, noise, 1.0 / inputs.sample_rate, ratio, start)
    options = IntegrationOptions(
        method,
        PAPER_COIL,
        initial_field=inputs.remanence if method in PAPER_METHODS else None,
        zero_reading=inputs.zero_reading,
        settling=float(np.interp(inputs.ramp_rate, *EDDY_SETTLING)),
        field_model=field_model if method == "cs2-identified" else None,
        noise=noise,
    )
    return make_integrator(options, source.record)


def experiment_fields(
    experiment: Experiment, methods: Sequence[str] = PAPER_METHODS, field_model: FieldModel | None = None
) -> dict[str, FieldBlock]:
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
    found: dict[str, FieldBlock] = {}
    for method in methods:
        source = experiment if method == "ffa1" else measured
        integrator = _integrator(method, source, field_model)
        found[method] = integrator.advance(integrator.start(), source.record)[1]
    return found


@dataclass(frozen=True, eq=False)
class _Part:
    """What the tables need of a piece: samples near the ends of (17), offsets, and squared errors on flat-tops."""

    near: FloatArray  # time, field and variance, shape (3, n)
    offset: tuple[float, float, float, int]  # smallest, largest, sum, samples
    squares: tuple[float, int]  # sum, samples


def _part(method: str, source: Experiment, block: FieldBlock) -> _Part:
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
    method: str,
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


TABLES = {
    1: ("offset voltage, mean and range over a second, uV", lambda row: _offset(row.offset_mean, row.offset_range)),
    2: ("global drift, ppm/s", lambda row: f"{1e6 * row.drift:.3g}"),
    3: ("total uncertainty (18) at the end against cs1, k = 2, uT", lambda row: f"{1e6 * row.uncertainty_end:.4g}"),
}
"""Title and cell of each of the paper's tables."""


def table_text(figures: Sequence[Figures], number: int) -> str:
    """One of the paper's tables, here and as printed.

    Parameters
    ----------
    number : int
        1, 2 or 3.
    """
    title, cell = TABLES[number]
    lines = [f"Table {number}: {title}; here / paper", f"{'A/s':>5} {'method':<15}"]
    for row in figures:
        printed, theirs = PAPER.get(row.method), ""
        if printed is not None and row.ramp_rate in PAPER_RAMP_RATES:
            place = PAPER_RAMP_RATES.index(row.ramp_rate)
            if number == 1 and printed.offset_mean is not None:
                limits = None if printed.offset_range is None else printed.offset_range[place]
                theirs = _offset(printed.offset_mean[place], limits)
            elif number > 1:
                theirs = f"{1e6 * (printed.drift if number == 2 else printed.uncertainty_end)[place]:.4g}"
        lines.append(f"{row.ramp_rate:>5g} {row.method:<15} {cell(row):<20} / {theirs or '-'}")
    return "\n".join(lines)


def _offset(mean: float, limits: tuple[float, float] | None) -> str:
    spread = "" if limits is None else f" [{1e6 * limits[0]:.0f}, {1e6 * limits[1]:.0f}]"
    return f"{1e6 * mean:.1f}{spread}"
