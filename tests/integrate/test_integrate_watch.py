"""Faults of coil and bench records are found, named, and nothing else is."""

import re
from dataclasses import replace

import numpy as np
import pytest
from arpaia2022.sensors import PAPER_COIL, PAPER_CURRENT_TO_FIELD

from femfit.integrate.bench_table import PlateauOptions, plateau_flux, watch_run
from femfit.integrate.field_of_current import field_of_ratio
from femfit.integrate.methods import IntegrationOptions, integrate_blocks, make_integrator
from femfit.integrate.record_watch import RecordWatch
from femfit.integrate.uncertainty import SensingCoil

DT = 1e-3


@pytest.fixture(scope="module")
def stretch(experiment):
    """From rest over the first ramp to the flat-top: 62 s at 1 kS/s."""
    return experiment.record[58_000:120_000]


def found(record, coil=PAPER_COIL, block=5000, ratio=PAPER_CURRENT_TO_FIELD):
    of_hall = record.hall is not None
    known = {} if of_hall else {"field_model": field_of_ratio(ratio, 1e-4)}
    options = IntegrationOptions("cs1-offset" if of_hall else "cs2", coil, **known)
    reference, scale = ("hall_T", 1.0) if of_hall else ("current_A", 1.0 / ratio)
    watch = RecordWatch(coil.area_m2, DT, reference, scale)
    blocks = [record[k : k + block] for k in range(0, len(record), block)]
    for given, out in integrate_blocks(make_integrator(options, blocks[0]), blocks):
        watch.see(given, out)
    return {finding.code: str(finding) for finding in watch.findings()}


def stumbling(record):
    time = record.time.copy()
    time[3000] = time[2999] + 0.1 * DT
    return replace(record, time=time)


def frozen(record):
    """The probe stands still over the ramp from 60 to 63 s."""
    return replace(record, hall=np.where((record.time > 60.5) & (record.time < 63.0), record.hall[2500], record.hall))


@pytest.mark.parametrize(
    ("fault", "block", "codes", "words"),
    [
        (lambda record: record, 777, set(), None),
        (lambda r: replace(r, hall=np.where(np.arange(len(r)) // 1000 == 5, np.nan, r.hall)), 62_000, set(), None),
        (stumbling, 777, {"clock"}, "60.999"),
        (frozen, 30, {"stuck", "innovations"}, "Hall probe, which stuck"),  # each block shorter than what lasts
        (lambda record: replace(record, voltage=-record.voltage), 5000, {"sign", "innovations"}, "sign"),
        (lambda record: replace(record, voltage=-record.voltage, hall=None), 777, {"sign", "innovations"}, "sign"),
    ],
)
def test_each_fault_is_found_and_suspected_in_blocks_of_any_size(fault, block, codes, words, stretch):
    findings = found(fault(stretch), block=block)
    assert codes <= set(findings)
    assert codes or not findings
    assert words is None or words in findings.get("innovations", findings[min(codes)])


@pytest.mark.parametrize("block", [777, 62_000])
def test_a_gap_is_counted_and_measured(block, stretch):
    rows = np.r_[0:20_000, 20_500:40_000, 40_010:62_000]
    sentence = found(stretch[rows], block=block)["gap"]
    assert re.findall(r"[\d.]+", sentence)[:3] == ["2", "78.5", "0.51"]


def test_a_wrong_area_is_found_and_the_right_one_proposed(stretch):
    findings = found(stretch, coil=SensingCoil(0.066))
    proposed = float(findings["gain"].split("an area of ")[1].split()[0])
    # The regression over ramps of 1 T with 10 uT of noise.
    assert proposed == pytest.approx(0.059394, rel=1e-3)
    assert "area" in findings["innovations"]


def test_a_wrong_ratio_of_current_to_field_is_found_and_the_right_one_proposed(stretch):
    record = replace(stretch, hall=None)
    assert "gain" not in found(record)
    finding = found(record, ratio=380.0)["gain"]
    proposed = float(finding.split("is wrong; ")[1].split()[0])
    # The magnet saturates by a per cent towards its top.
    assert proposed == pytest.approx(PAPER_CURRENT_TO_FIELD, rel=0.02)


def test_without_a_ratio_the_signs_alone_are_compared(stretch):
    for voltage, expected in ((stretch.voltage, []), (-stretch.voltage, ["sign"])):
        watch = RecordWatch(PAPER_COIL.area_m2, DT, "current_A")
        watch.see(replace(stretch, voltage=voltage))
        assert [finding.code for finding in watch.findings()] == expected


RESISTANCE = 2.0
RAMP = np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, 40)) ** 2
CURRENT = np.concatenate([np.zeros(100), RAMP, np.ones(100), 1.0 - RAMP, np.zeros(100)])
TIME = 0.01 * np.arange(len(CURRENT))
INDUCED = 0.02 * np.gradient(CURRENT, TIME) + np.random.default_rng(1).normal(0.0, 1e-6, len(CURRENT))
VOLTS = INDUCED + RESISTANCE * CURRENT


def watched(rows, voltage, taken=RESISTANCE):
    time, current = TIME[rows], CURRENT[rows]
    without = voltage - taken * current
    found = plateau_flux(time, without, current, np.full(len(rows), 0.02), PlateauOptions())
    return found, [one.code for one in watch_run(time, voltage, without, current, found)]


ALL = np.arange(len(CURRENT))


@pytest.mark.parametrize(
    ("read", "taken", "codes"),
    [
        # A converter of 1 mV reads the top plateau's R i of 2 V, its largest voltage, again and again
        (np.round(VOLTS, 3), RESISTANCE, []),
        (np.clip(VOLTS, -1.5, 1.5), RESISTANCE, ["clipped"]),
        (-INDUCED, 0.0, ["sign"]),
    ],
    ids=["readings that repeat on a plateau", "a change cut off at the limit", "a coil wired the wrong way round"],
)
def test_what_a_converter_or_a_coil_does_is_named(read, taken, codes):
    assert watched(ALL, read, taken)[1] == codes


@pytest.mark.parametrize("lost", [range(110, 125), range(40, 60)], ids=["between plateaus", "on a plateau"])
def test_a_gap_is_named(lost):
    rows = np.delete(ALL, lost)
    found, kinds = watched(rows, VOLTS[rows])
    assert kinds == ["gap"]
    assert found.sigma[1] < 1e-6
