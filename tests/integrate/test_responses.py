"""Responses of the filters to what is systematic; the paper's folded recursions."""

from dataclasses import replace

import numpy as np
import pytest
from arpaia2022.kalman import KalmanIntegrator
from arpaia2022.sensors import PAPER_COIL

from femfit.integrate.offset_filter import OffsetFilter
from femfit.integrate.uncertainty import LinearSigma, Noise
from femfit.tables.coil_record import CoilBlock
from support.field_blocks import run

DT = 1e-3
NOISE = Noise(LinearSigma(2e-6), LinearSigma(1e-5), 1e-3)


def made(samples, seed=1, wander=1e-6):
    """A moving field, its coil with an offset that walks, and its probe."""
    rng = np.random.default_rng(seed)
    time = np.arange(samples) * DT
    field = 0.5 + 0.01 * np.sin(3.0 * time)
    offset = 5e-6 + np.cumsum(rng.normal(size=samples)) * wander * np.sqrt(DT)
    voltage = 0.059394 * 0.03 * np.cos(3.0 * time) + offset + 2e-6 * rng.normal(size=samples)
    return CoilBlock(time, voltage, field + 1e-5 * rng.normal(size=samples))


@pytest.mark.parametrize(("name", "change"), [("reference", 1e-3), ("reference_unit", 1e-4), ("voltage_unit", 1e-6)])
@pytest.mark.parametrize("integrator", [OffsetFilter, KalmanIntegrator])
def test_responses_are_what_a_systematic_error_does_to_the_field(name, change, integrator):
    record = made(3000)
    wrong = {
        "reference": replace(record, hall=record.hall * (1.0 + change)),
        "reference_unit": replace(record, hall=record.hall + change),
        "voltage_unit": replace(record, voltage=record.voltage + change),
    }[name]
    integrator = integrator(PAPER_COIL, NOISE, DT, initial_field=0.4)
    block = run(integrator, record)
    moved = (run(integrator, wrong).field - block.field) / change
    expected = getattr(block.responses, name)
    # Both are linear in the record; differences of 1 T over the change keep ten digits.
    np.testing.assert_allclose(moved, expected, rtol=1e-6, atol=1e-9 * max(1.0, abs(expected).max()))
