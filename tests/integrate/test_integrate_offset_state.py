"""The filter whose second state is the offset voltage, with a Hall probe and with an identified field."""

from dataclasses import replace

import numpy as np
import pytest
from arpaia2022.experiment import ExperimentInputs, synthesise
from arpaia2022.sensors import PAPER_COIL

from femfit.core.errors import TableError
from femfit.integrate.identified_field import LabRun, identify_field
from femfit.integrate.offset_filter import OffsetFilter
from femfit.integrate.uncertainty import LinearSigma, Noise
from femfit.tables.coil_record import CoilBlock
from support.field_blocks import run

DT = 1e-3
INPUTS = ExperimentInputs(ramp_rate=100.0)
NOISE = Noise(
    LinearSigma(INPUTS.voltage_density * np.sqrt(500.0)), LinearSigma(INPUTS.hall_density * np.sqrt(500.0)), 1e-3
)
HALL = OffsetFilter(PAPER_COIL, NOISE, DT)


def of_current(model):
    """The filter with a field model, weighed by the model's own error."""
    return replace(HALL, noise=replace(NOISE, reference=LinearSigma(model.rms_T)), field_model=model)


def plateau_rms(block, experiment, settling=30.0):
    """Rms of the error on each settled flat-top, T."""
    error = block.field - experiment.field
    return [
        float(np.sqrt(np.mean(error[(block.time > begin + settling) & (block.time < end)] ** 2)))
        for begin, end in experiment.flat_tops
    ]


@pytest.fixture(scope="module")
def field_model():
    """Identified from two lab runs by the Hall probe's filter; no run has an amplitude of the tests."""
    runs = []
    for seed, rate, peaks in (
        (10, 32.0, (320.0, 280.0, 240.0, 160.0, 80.0)),
        (11, 100.0, (320.0, 120.0, 320.0, 200.0)),
    ):
        lab = synthesise(ExperimentInputs(ramp_rate=rate, amplitudes=peaks), np.random.default_rng(seed))
        lab = lab.after_zero_reading()
        runs.append(LabRun(lab.record.time, lab.record.current, run(HALL, lab.record).field))
    return identify_field(runs)


@pytest.mark.parametrize("identified", [False, True], ids=["hall", "identified"])
def test_online_gives_the_numbers_of_offline(identified, experiment, field_model):
    integrator = of_current(field_model) if identified else HALL
    stretch = experiment.record[60_000:63_000]
    whole, pieces = run(integrator, stretch), run(integrator, stretch, range(1, 3000))
    for column in ("field", "offset", "variance", "innovation"):
        expected = getattr(whole, column)
        np.testing.assert_allclose(
            getattr(pieces, column), expected, rtol=1e-9, atol=1e-11 * np.nanmax(np.abs(expected))
        )


def test_plateaus_are_right_to_10_microtesla(experiment):
    measured = experiment.after_zero_reading()
    block = run(HALL, measured.record)
    # The figure; the paper's one-state filter is off by 45 uT here.
    assert max(plateau_rms(block, measured)) < 10e-6


def test_a_constant_offset_is_found_and_leaves_no_lag():
    time = np.arange(20_000) * DT
    block = run(HALL, CoilBlock(time, np.full(20_000, 7e-6), np.full(20_000, 1.0)))
    # Noiseless: what is left after 50 time constants is rounding.
    assert block.offset[-1] == pytest.approx(7e-6, rel=1e-6)
    assert block.field[-1] == pytest.approx(1.0, abs=1e-10)


def test_innovations_of_a_true_filter_are_as_large_as_it_says():
    rng = np.random.default_rng(4)
    samples, wander = 100_000, 1e-6
    time = np.arange(samples) * DT
    offset = 5e-6 + np.cumsum(rng.normal(size=samples)) * wander * np.sqrt(DT)
    voltage = offset + NOISE.voltage.floor * rng.normal(size=samples)
    hall = 0.5 + NOISE.reference.floor * rng.normal(size=samples)
    block = run(replace(HALL, offset_wander=wander), CoilBlock(time, voltage, hall))
    used = np.isfinite(block.innovation)
    used[:5000] = False
    squares = block.innovation[used] ** 2 / block.innovation_variance[used]
    # 4750 corrections: chi-square's mean is 1 within 2 % (one standard deviation).
    assert np.mean(squares) == pytest.approx(1.0, abs=0.06)
    error = (block.field - 0.5)[5000:]
    assert np.sqrt(np.mean(error**2)) == pytest.approx(np.sqrt(block.variance[-1]), rel=0.2)


@pytest.mark.parametrize("part", ["coil", "reference", "voltage"])
def test_sensitivities_are_those_of_a_changed_record(part, experiment):
    record, small = experiment.record[60_000:66_000], 1e-3
    integrator = replace(HALL, initial_field=0.0)
    changes = {
        "coil": CoilBlock(record.time, record.voltage * (1 + small), record.hall),
        "reference": CoilBlock(record.time, record.voltage, record.hall * (1 + small)),
        "voltage": CoilBlock(record.time, record.voltage + small, record.hall),
    }
    base, moved = run(integrator, record), run(integrator, changes[part])
    told = base.responses.voltage_unit if part == "voltage" else getattr(base.responses, part)
    # Linear but for rounding: 1e-16 of 1 T over a change of 1e-3, times the sums' length.
    expected = (moved.field - base.field) / small
    np.testing.assert_allclose(told, expected, atol=1e-9 * max(1.0, float(np.abs(told).max())))


@pytest.mark.parametrize(
    ("rate", "peaks"),
    [(100.0, (260.0, 140.0, 300.0)), pytest.param(32.0, (180.0, 220.0, 100.0), marks=pytest.mark.long)],
)
def test_an_identified_field_holds_on_other_amplitudes(rate, peaks, field_model):
    inputs = ExperimentInputs(ramp_rate=rate, amplitudes=peaks)
    other = synthesise(inputs, np.random.default_rng(5)).after_zero_reading()
    block = run(of_current(field_model), other.record)
    # The figure; the ratio I / g alone is off by 0.2 to 5 mT there.
    assert max(plateau_rms(block, other)) < 100e-6


@pytest.mark.parametrize("cuts", [(), (100, 500, 900)], ids=["whole", "blocks"])
def test_nothing_is_known_before_the_first_reading(cuts, experiment):
    stretch = experiment.record[60_000:62_000]
    hall = stretch.hall.copy()
    hall[:700] = np.nan
    integrator = HALL
    late = run(integrator, CoilBlock(stretch.time, stretch.voltage, hall), cuts)
    assert np.all(np.isnan(late.field[:700]))
    np.testing.assert_allclose(late.field[700:], run(integrator, stretch[700:]).field, rtol=1e-12)


def test_a_filter_without_its_reference_says_which_column_it_needs(field_model):
    record = CoilBlock(np.arange(3) * DT, np.zeros(3))
    with pytest.raises(TableError, match="hall_T"):
        run(HALL, record)
    with pytest.raises(TableError, match="current_A"):
        run(of_current(field_model), record)
