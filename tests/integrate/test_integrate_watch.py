"""Faults put into a good record are found, named, and nothing else is."""

import numpy as np
import pytest
from arpaia2022.sensors import PAPER_COIL, PAPER_CURRENT_TO_FIELD

from femfit.integrate.identified_field import field_of_ratio
from femfit.integrate.methods import IntegrationOptions, integrate_blocks, make_integrator
from femfit.integrate.record_watch import RecordWatch
from femfit.integrate.uncertainty import LinearSigma, SensingCoil
from femfit.tables.coil_record import CoilBlock

DT = 1e-3


@pytest.fixture(scope="module")
def stretch(experiment):
    """From rest over the first ramp to the flat-top: 62 s at 1 kS/s."""
    return experiment.record[58_000:120_000]


def found(record, coil=PAPER_COIL, block=5000, of_hall=True, ratio=PAPER_CURRENT_TO_FIELD):
    known = {} if of_hall else {"field_model": field_of_ratio(ratio, LinearSigma(1e-4)).model}
    options = IntegrationOptions("cs1-offset" if of_hall else "cs2", coil, **known)
    reference, scale = ("hall_T", 1.0) if of_hall else ("current_A", 1.0 / ratio)
    watch = RecordWatch(coil.area_m2, DT, reference, scale)
    blocks = [record[k : k + block] for k in range(0, len(record), block)]
    for given, out in integrate_blocks(make_integrator(options, blocks[0]), blocks):
        watch.see(given, out)
    return {finding.code: str(finding) for finding in watch.findings()}


def changed(record, **columns):
    names = ("time", "voltage", "hall", "current")
    return CoilBlock(*(columns.get(name, getattr(record, name)) for name in names))


@pytest.mark.parametrize("block", [777, 5000, 62_000])
def test_a_good_record_has_no_findings(block, stretch):
    assert found(stretch, block=block) == {}


@pytest.mark.parametrize("block", [777, 62_000])
def test_a_gap_is_counted_and_measured(block, stretch):
    rows = np.r_[0:20_000, 20_500:40_000, 40_010:62_000]
    sentence = found(stretch[rows], block=block)["gap"]
    assert sentence.startswith("2 gaps, first before 78.5 s, 0.51 s lost in all")


def test_a_clock_that_stumbles_is_found(stretch):
    time = stretch.time.copy()
    time[3000] = time[2999] + 0.1 * DT
    assert "after less than half a sample time, first at 60.999" in found(changed(stretch, time=time))["clock"]


def test_a_converter_that_clips_is_found(stretch):
    clipped = changed(stretch, voltage=np.minimum(stretch.voltage, 0.0185))
    findings = found(clipped)
    assert "the converter clipped" in findings["clipped"]


@pytest.mark.parametrize("block", [777, 62_000])
def test_a_probe_that_sticks_is_found_and_suspected(block, stretch):
    hall = stretch.hall.copy()
    hall[3000:20_000] = hall[3000]
    findings = found(changed(stretch, hall=hall), block=block)
    assert "it stuck" in findings["stuck"]
    assert "saturated" not in findings
    assert findings["innovations"].endswith("Suspect: the Hall probe, which stuck.")


def test_a_probe_that_saturates_is_found_and_suspected(stretch):
    findings = found(changed(stretch, hall=np.minimum(stretch.hall, 0.5)))
    assert "it saturated" in findings["saturated"]
    assert findings["innovations"].endswith("Suspect: the Hall probe, which saturated.")


@pytest.mark.parametrize("of_hall", [True, False], ids=["hall", "current"])
def test_a_coil_wired_the_wrong_way_is_found_and_suspected(of_hall, stretch):
    record = changed(stretch, voltage=-stretch.voltage)
    if not of_hall:
        record = changed(record, hall=None)
    findings = found(record, of_hall=of_hall)
    assert "wrong way round" in findings["sign"]
    assert findings["innovations"].endswith("Suspect: the sign of the coil's voltage.")


def test_a_wrong_area_is_found_and_the_right_one_proposed(stretch):
    findings = found(stretch, coil=SensingCoil(0.066))
    proposed = float(findings["gain"].split("an area of ")[1].split()[0])
    # The regression over ramps of 1 T with 10 uT of noise.
    assert proposed == pytest.approx(0.059394, rel=1e-3)
    assert "Suspect: the coil's area" in findings["innovations"]


def test_a_wrong_ratio_of_current_to_field_is_found_and_the_right_one_proposed(stretch):
    record = changed(stretch, hall=None)
    assert "gain" not in found(record, of_hall=False)
    finding = found(record, of_hall=False, ratio=380.0)["gain"]
    proposed = float(finding.split("is wrong; ")[1].split()[0])
    # The magnet saturates by a per cent towards its top.
    assert proposed == pytest.approx(PAPER_CURRENT_TO_FIELD, rel=0.02)


def test_without_a_ratio_the_signs_alone_are_compared(stretch):
    for voltage, expected in ((stretch.voltage, []), (-stretch.voltage, ["sign"])):
        watch = RecordWatch(PAPER_COIL.area_m2, DT, "current_A")
        watch.see(changed(stretch, voltage=voltage))
        assert [finding.code for finding in watch.findings()] == expected


def test_missing_readings_are_no_fault(stretch):
    hall = stretch.hall.copy()
    hall[5000:6000] = np.nan
    assert found(changed(stretch, hall=hall)) == {}


def test_findings_stream_like_they_are_read_at_once(stretch):
    hall = np.minimum(stretch.hall, 0.5)
    faulty = changed(stretch, hall=hall, voltage=-stretch.voltage)[np.r_[0:5000, 5500:62_000]]
    assert set(found(faulty, block=62_000)) == set(found(faulty, block=1000))
