"""The paper's experiment as synthetic data: cycles of a magnet, its coil and Hall probe, an offset that flickers.

The magnet is none of the models that the filters use: a saturating curve that is no polynomial, forty play operators
that saturation weakens, an eddy lag driven by the field. Everything in :class:`ExperimentInputs` is put in, not found.

References
----------
P. Arpaia et al., Sensors 22 (2022) 182, sections 2.2 and 3, Figure 4, Table 1.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from arpaia2022.parallel_prefix import Folding, affine_recursion
from arpaia2022.sensors import PAPER_COIL
from femfit.core.numerics import FloatArray
from femfit.integrate.field_of_current import play_paths
from femfit.integrate.uncertainty import SensingCoil
from femfit.tables.coil_record import CoilBlock

PAPER_RAMP_RATES = (3.2, 32.0, 100.0)
"""A/s."""

# The magnet is solved on this grid (s), which every corner of the paper's cycles lies on.
_GRID = 0.01


@dataclass(frozen=True)
class ExperimentInputs:
    """What the synthetic experiment assumes; the defaults marked * are the paper's, the others are chosen here.

    Parameters
    ----------
    amplitudes : tuple of float
        Flat-top current of each cycle, A *.
    sample_rate : float
        Hz; the paper's figures follow from 204.8 kHz, see :data:`PAPER_SAMPLE_RATE`.
    plateau, zero_reading : float
        Of each plateau, and before the first ramp, s *.
    current_max : float
        To which the magnet was cycled before, A *.
    field_at_top : float
        At ``current_max``, T: 0.26 mT below 320 A / 316 A/T, which sets the plateau error of CS2.
    saturation : float
        Relative loss of slope of the magnetisation curve at the top.
    eddy_relative, eddy_time, eddy_rate : float
        Transient after a ramp at ``eddy_rate`` relative to the field at the top *, its time constant in s *, A/s *.
    offset_mean, offset_rms, offset_limits : float, float, (float, float)
        Of the flickering offset voltage, V; mean and limits *.
    voltage_density : float
        White noise of the voltage, V/sqrt(Hz).
    hall_density, hall_wander : float
        White noise of the Hall probe in T/sqrt(Hz), and rms of its flicker in T.
    hall_gain : float
        Relative gain error of the Hall probe.
    current_density, supply_wander : float
        White noise of the current reading in A/sqrt(Hz), and rms of the supply's flicker in A.
    """

    ramp_rate: float = 100.0
    amplitudes: tuple[float, ...] = (320.0, 320.0, 320.0)
    sample_rate: float = 1000.0
    plateau: float = 60.0
    zero_reading: float = 60.0
    current_max: float = 320.0
    coil: SensingCoil = PAPER_COIL
    field_at_top: float = 320.0 / 316.0 - 0.26e-3
    saturation: float = 0.01
    remanence: float = 2.27e-3
    eddy_relative: float = 120e-6
    eddy_time: float = 10.0
    eddy_rate: float = 100.0
    offset_mean: float = 7e-6
    offset_rms: float = 4e-6
    offset_limits: tuple[float, float] = (-11e-6, 24e-6)
    voltage_density: float = 50e-9
    hall_density: float = 0.5e-6
    hall_wander: float = 1e-6
    hall_gain: float = 0.0
    current_density: float = 2e-4
    supply_wander: float = 1e-3


@dataclass(frozen=True, eq=False)
class Experiment:
    """A record and, apart from it, the truth.

    Parameters
    ----------
    record : CoilBlock
        What an instrument would have read, the zero reading first.
    field, offset : array, shape (n,)
        True field in T and offset voltage in V.
    flat_tops : tuple of (float, float)
        Begin and end of each flat-top, s.
    """

    inputs: ExperimentInputs
    record: CoilBlock
    field: FloatArray
    offset: FloatArray
    flat_tops: tuple[tuple[float, float], ...]

    def after_zero_reading(self) -> "Experiment":
        """The measurement alone: what every method but FFA1 starts from."""
        first = int(np.searchsorted(self.record.time, self.inputs.zero_reading - 1e-9))
        rows = slice(first, None)
        return Experiment(self.inputs, self.record[rows], self.field[rows], self.offset[rows], self.flat_tops)


@dataclass(frozen=True, eq=False)
class Course:
    """What the experiment does before anything samples it, on a grid that every corner lies on.

    Parameters
    ----------
    time, supply, field, offset, probe : array, shape (g,)
        Grid in s; current in A, true field in T, offset voltage in V, and the Hall probe's wander in T.
    flat_tops : tuple of (float, float)
        Begin and end of each flat-top, s.
    """

    inputs: ExperimentInputs
    time: FloatArray
    supply: FloatArray
    field: FloatArray
    offset: FloatArray
    probe: FloatArray
    flat_tops: tuple[tuple[float, float], ...]

    @property
    def samples(self) -> int:
        """Of the whole record."""
        return round(float(self.time[-1]) * self.inputs.sample_rate) + 1

    def piece(self, first: int, last: int, rng: np.random.Generator) -> Experiment:
        """Samples ``first`` to ``last`` (exclusive), with noise of their own."""
        inputs = self.inputs
        wide = np.arange(max(first - 1, 0), min(last + 1, self.samples)) / inputs.sample_rate
        inner = slice(first - max(first - 1, 0), None)
        time = wide[inner][: last - first]
        truth = np.interp(wide, self.time, self.field)
        induced = inputs.coil.area_m2 * np.gradient(truth, 1.0 / inputs.sample_rate)[inner][: last - first]
        truth, offset = truth[inner][: last - first], np.interp(time, self.time, self.offset)

        def white(density: float) -> FloatArray:
            return np.asarray(density * np.sqrt(0.5 * inputs.sample_rate) * rng.normal(size=len(time)))

        probe = (1.0 + inputs.hall_gain) * truth + np.interp(time, self.time, self.probe)
        record = CoilBlock(
            time,
            induced + offset + white(inputs.voltage_density),
            probe + white(inputs.hall_density),
            np.interp(time, self.time, self.supply) + white(inputs.current_density),
        )
        return Experiment(inputs, record, truth, offset, self.flat_tops)


def make_course(inputs: ExperimentInputs, rng: np.random.Generator) -> Course:
    """Solve the magnet and draw what wanders."""
    knots, flat_tops = _schedule(inputs)
    grid = np.arange(round(knots[0][-1] / _GRID) + 1) * _GRID
    supply = np.interp(grid, *knots) + flicker(grid, inputs.supply_wander, rng)
    static = _static_field(inputs, supply)
    field = static - _eddy_field(inputs, grid, static)
    offset = _offset(inputs, grid, rng)
    return Course(inputs, grid, supply, field, offset, flicker(grid, inputs.hall_wander, rng), flat_tops)


def synthesise(inputs: ExperimentInputs, rng: np.random.Generator) -> Experiment:
    """Make a record."""
    course = make_course(inputs, rng)
    return course.piece(0, course.samples, rng)


def stream_pieces(course: Course, rows: int, rng: np.random.Generator) -> Iterator[Experiment]:
    """The record piece by piece, for one that does not fit the memory.

    Yields
    ------
    Experiment
        In order; together what :func:`synthesise` makes at once, but for the noise drawn.
    """
    for first in range(0, course.samples, rows):
        yield course.piece(first, min(first + rows, course.samples), rng)


def flicker(time: FloatArray, rms: float, rng: np.random.Generator) -> FloatArray:
    """Noise whose spectral density falls as 1/f, from one period of the record up to 5 Hz.

    Parameters
    ----------
    time : array, shape (n,)
        Even grid, s.

    Returns
    -------
    array, shape (n,)
        Zero mean.
    """
    frequency = np.fft.rfftfreq(len(time), float(time[1] - time[0]))
    shape = np.zeros(len(frequency))
    band = (frequency > 0.0) & (frequency <= 5.0)
    shape[band] = frequency[band] ** -0.5
    spectrum = shape * (rng.normal(size=len(shape)) + 1j * rng.normal(size=len(shape)))
    values = np.fft.irfft(spectrum, len(time))
    return np.asarray(values * (rms / np.std(values)))


def _schedule(inputs: ExperimentInputs) -> tuple[tuple[FloatArray, FloatArray], tuple[tuple[float, float], ...]]:
    """Corners of the current's path, and the flat-tops."""
    times, currents, flat_tops = [0.0, inputs.zero_reading], [0.0, 0.0], []
    for amplitude in inputs.amplitudes:
        ramp, now = amplitude / inputs.ramp_rate, times[-1]
        corners = np.cumsum([ramp, inputs.plateau, ramp, inputs.plateau]) + now
        times += corners.tolist()
        currents += [amplitude, amplitude, 0.0, 0.0]
        flat_tops.append((float(corners[0]), float(corners[1])))
    return (np.array(times), np.array(currents)), tuple(flat_tops)


def _static_field(inputs: ExperimentInputs, current: FloatArray) -> FloatArray:
    """Field without eddy currents: a saturating curve and a loop that saturation narrows."""
    radii = np.linspace(2.0, 158.0, 40)
    weights = np.exp(-radii / 40.0)
    top = inputs.current_max

    def loop(plays: FloatArray, at: FloatArray) -> FloatArray:
        behind = (plays - at[:, None]) @ weights
        return np.asarray(behind / (1.0 + (at / (0.78 * top)) ** 4))

    def curve(at: FloatArray) -> FloatArray:
        x = at / top
        return np.asarray(x / (1.0 + 6.0 * inputs.saturation * np.abs(x) ** 6) ** (1.0 / 6.0))

    rest = np.clip(top - radii, 0.0, radii)
    size = inputs.remanence / float(weights @ rest)
    ends = np.array([top])
    lift = inputs.field_at_top - size * float(loop(play_paths(radii, rest, ends), ends)[0])
    return np.asarray(lift * curve(current) / curve(ends) + size * loop(play_paths(radii, rest, current), current))


def _eddy_field(inputs: ExperimentInputs, time: FloatArray, static: FloatArray) -> FloatArray:
    """What eddy currents keep away: e' = -e / tau + c dB/dt, c from the transient after the stated ramp."""
    ramp = inputs.current_max / inputs.eddy_rate
    tau = inputs.eddy_time
    share = inputs.eddy_relative * ramp / (tau * (1.0 - np.exp(-ramp / tau)))
    keep = float(np.exp(-_GRID / tau))
    drive = share * tau / _GRID * (1.0 - keep) * np.diff(static, prepend=static[0])
    folding = Folding(len(time))
    return folding.unfold(
        affine_recursion(folding.fold(np.full(len(time), keep), 1.0), [folding.fold(drive, 0.0)], [0.0])[0]
    )


def _offset(inputs: ExperimentInputs, time: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Flicker around the mean, shrunk where it would pass the limits."""
    wander = flicker(time, inputs.offset_rms, rng)
    low, high = inputs.offset_limits
    factor = min(
        1.0,
        (high - inputs.offset_mean) / float(wander.max()),
        (inputs.offset_mean - low) / -float(wander.min()),
    )
    return inputs.offset_mean + factor * wander
