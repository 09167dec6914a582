"""Feed-forward and filtering integrators: online as offline, closed forms, the papers' figures, identified fields."""

from dataclasses import replace

import numpy as np
import pytest
from arpaia2022.experiment import ExperimentInputs, synthesise
from arpaia2022.kalman import KalmanIntegrator
from arpaia2022.sensors import PAPER_COIL

from femfit.core.errors import TableError
from femfit.integrate.feed_forward import PlateauIntegrator, ZeroReadingIntegrator
from femfit.integrate.field_of_current import FieldModel, FieldTerms, LabRun, identify_field
from femfit.integrate.integrator import Integrator
from femfit.integrate.offset_filter import OffsetFilter
from femfit.integrate.uncertainty import LinearSigma, Noise, SensingCoil
from femfit.tables.coil_record import CoilBlock
from support.field_blocks import run

DT = 1e-3
SLOW = 200.0
"""Samples a second of what takes minutes."""


def hall_filter(rate, model=None):
    """The filter with an offset state, at the densities of the experiment, or with a field model and its error."""
    inputs, root = ExperimentInputs(), np.sqrt(0.5 * rate)
    reference = LinearSigma(inputs.hall_density * root if model is None else model.rms_T)
    noise = Noise(LinearSigma(inputs.voltage_density * root), reference, 1e-3)
    return OffsetFilter(PAPER_COIL, noise, 1.0 / rate, field_model=model)


HALL = hall_filter(1.0 / DT)
MAGNET = FieldModel(FieldTerms(320.0, 1, (20.0,), (10.0,)), np.array([0.5, 0.5, 4e-6, 4e-6, 4e-6, 1e-6]), 1e-3)
"""A field of the current with hysteresis and eddy currents."""

QUIET = Noise(LinearSigma(1e-6), LinearSigma(1e-5), 1e-3)
INTEGRATORS = {
    "trapezoid": Integrator(PAPER_COIL, QUIET, DT),
    "ffa1": ZeroReadingIntegrator(PAPER_COIL, QUIET, DT, zero_reading=0.2),
    "ffa2": PlateauIntegrator(PAPER_COIL, QUIET, DT, settling=0.1, interval=0.05),
    "cs1": KalmanIntegrator(PAPER_COIL, QUIET, DT),
    "cs2": KalmanIntegrator(PAPER_COIL, QUIET, DT, current_to_field=316.0, initial_field=0.0),
    "offset": HALL,
    "field model": hall_filter(1.0 / DT, MAGNET),
}


@pytest.mark.parametrize("name", INTEGRATORS)
@pytest.mark.parametrize("cuts", [(*range(1, 1200), 3000), (1, 130, 131, 3000)], ids=["sample by sample", "blocks"])
def test_online_gives_the_numbers_of_offline(name, cuts, experiment):
    integrator, first = INTEGRATORS[name], int(59.5 / DT)
    stretch = experiment.record[first : first + 5000]  # around the first ramp
    whole, pieces = run(integrator, stretch), run(integrator, stretch, cuts)
    for column in ("field", "variance", "offset", "innovation", "innovation_variance"):
        expected = getattr(whole, column)
        # Rounding of 5000 additions of numbers of order one.
        scale = np.nanmax(np.abs(expected), initial=1e-30)
        np.testing.assert_allclose(getattr(pieces, column), expected, rtol=1e-9, atol=1e-12 * scale)
    for part in ("coil", "reference", "reference_unit", "voltage_unit"):
        np.testing.assert_allclose(getattr(pieces.responses, part), getattr(whole.responses, part), atol=1e-10)


@pytest.mark.parametrize("with_current", [True, False])
def test_plateau_mean_is_not_updated_on_ramps_and_while_eddy_currents_decay(experiment, with_current):
    record = experiment.record if with_current else replace(experiment.record, hall=None, current=None)
    block = run(PlateauIntegrator(PAPER_COIL, QUIET, DT, settling=30.0), record)
    begin, end = experiment.flat_tops[0]
    waiting = (block.time > 61.1) & (block.time < begin + 30.0)
    assert len(np.unique(block.offset[waiting])) == 1
    updates = np.flatnonzero(np.diff(block.offset) != 0.0) + 1
    updates = updates[(block.time[updates] > begin + 30.0) & (block.time[updates] < end)]
    assert len(updates) >= 25
    for k in updates:
        # What it must be: the offset, and what supply and eddy currents still move the field by. 35 nV of noise.
        moved = 0.059394 * (experiment.field[k - 1] - experiment.field[k - 1000])
        assert block.offset[k] == pytest.approx(np.mean(experiment.offset[k - 1000 : k]) + moved, abs=0.15e-6)


def test_a_record_without_the_reference_and_a_coil_without_area_are_refused():
    record = CoilBlock(np.arange(3) * DT, np.zeros(3))
    for integrator, column in ((HALL, "hall_T"), (INTEGRATORS["field model"], "current_A")):
        with pytest.raises(TableError, match=column):
            run(integrator, record)
    for area in (0.0, -0.1, np.nan, np.inf):
        with pytest.raises(TableError, match="> 0 m2"):
            SensingCoil(area)


def test_plateaus_are_told_at_the_papers_sample_rate():
    # White noise of 0.064 A at 204.8 kS/s, whose extremes in a second are 0.6 A apart, about a limit of 0.1 A.
    rate, rng = 204.8e3, np.random.default_rng(6)
    time = np.arange(round(2.5 * rate)) / rate
    current = np.where(time < 1.0, 320.0, 320.0 - 3.2 * (time - 1.0)) + 0.064 * rng.normal(size=len(time))
    record = CoilBlock(time, np.full(len(time), 7e-6), None, current)
    integrator = PlateauIntegrator(PAPER_COIL, QUIET, 1.0 / rate, settling=0.0)
    state, on_plateau = integrator.advance(integrator.start(), record[: round(1.2 * rate)])
    # The mean of the first second holds from there on; the ramp after it is no plateau.
    assert on_plateau.offset[-1] == pytest.approx(7e-6)
    state, on_ramp = integrator.advance(state, record[round(1.2 * rate) :])
    assert len(np.unique(on_ramp.offset)) == 1
    assert state.memory.still == 0.0


def test_innovations_of_a_true_filter_are_as_large_as_it_says():
    rng = np.random.default_rng(4)
    samples, wander = 100_000, 1e-6
    time = np.arange(samples) * DT
    offset = 5e-6 + np.cumsum(rng.normal(size=samples)) * wander * np.sqrt(DT)
    voltage = offset + HALL.noise.voltage.floor * rng.normal(size=samples)
    hall = 0.5 + HALL.noise.reference.floor * rng.normal(size=samples)
    block = run(replace(HALL, offset_wander=wander), CoilBlock(time, voltage, hall))
    used = np.isfinite(block.innovation)
    used[:5000] = False
    squares = block.innovation[used] ** 2 / block.innovation_variance[used]
    # 4750 corrections: chi-square's mean is 1 within 2 % (one standard deviation).
    assert np.mean(squares) == pytest.approx(1.0, abs=0.06)
    error = (block.field - 0.5)[5000:]
    assert np.sqrt(np.mean(error**2)) == pytest.approx(np.sqrt(block.variance[-1]), rel=0.2)


@pytest.mark.nightly
def test_an_identified_field_holds_on_other_amplitudes():
    def measured(rate, seed, *peaks):
        inputs = ExperimentInputs(ramp_rate=rate, amplitudes=peaks, sample_rate=SLOW)
        return synthesise(inputs, np.random.default_rng(seed)).after_zero_reading()

    labs = measured(32.0, 10, 320.0, 280.0, 240.0, 160.0, 80.0), measured(100.0, 11, 320.0, 120.0, 320.0, 200.0)
    fields = [run(hall_filter(SLOW), lab.record).field for lab in labs]
    runs = [LabRun(lab.record.time, lab.record.current, field) for lab, field in zip(labs, fields, strict=True)]
    field_model = identify_field(runs)  # no run has an amplitude of the tests
    for other in (measured(100.0, 5, 260.0, 140.0, 300.0), measured(32.0, 5, 180.0, 220.0, 100.0)):
        block = run(hall_filter(SLOW, field_model), other.record)
        settled = [(block.time > begin + 30.0) & (block.time < end) for begin, end in other.flat_tops]
        errors = [np.sqrt(np.mean((block.field - other.field)[rows] ** 2)) for rows in settled]
        # The figure; the ratio I / g alone is off by 0.2 to 5 mT there.
        assert max(errors) < 100e-6


@pytest.mark.parametrize("cuts", [(), (100, 500, 900)], ids=["whole", "blocks"])
def test_nothing_is_known_before_the_first_reading(cuts, experiment):
    stretch = experiment.record[60_000:62_000]
    hall = stretch.hall.copy()
    hall[:700] = np.nan
    late = run(HALL, CoilBlock(stretch.time, stretch.voltage, hall), cuts)
    assert np.all(np.isnan(late.field[:700]))
    np.testing.assert_allclose(late.field[700:], run(HALL, stretch[700:]).field, rtol=1e-12)
