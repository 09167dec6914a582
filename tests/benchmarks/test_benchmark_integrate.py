"""How fast and in how much memory a coil record is filtered; run with ``-m benchmark -s``.

The paper's longest record: 1,100 s at 204.8 kS/s, 225 million samples of voltage and Hall probe, 1.8 GB as raw float32,
and 4.5 GB of result. FEMFIT_BENCHMARK_SAMPLES makes it shorter.
"""

import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from arpaia2022.sensors import PAPER_SAMPLE_RATE

from femfit.integrate.record_stream import RecordWriter

pytestmark = pytest.mark.benchmark

SAMPLES = int(os.environ.get("FEMFIT_BENCHMARK_SAMPLES", "225280000"))
BLOCK = 2**18
FEMFIT = str(Path(sys.executable).with_name("femfit"))


def noisy(rng):
    """Voltage and Hall probe at rest in 1 T."""
    return 7e-6 + 1.6e-5 * rng.normal(size=BLOCK), 1.0 + 1.6e-4 * rng.normal(size=BLOCK)


@pytest.mark.parametrize("method", ["ffa2", "cs1-offset"])
def test_the_whole_command(method, tmp_path):
    rng, done = np.random.default_rng(0), 0
    names = ["time_s", "coil_voltage_V", "hall_T"]
    with RecordWriter(tmp_path / "coil.bin", names, 1.0 / PAPER_SAMPLE_RATE) as writer:
        voltage, hall = noisy(rng)
        while done < SAMPLES:
            rows = min(BLOCK, SAMPLES - done)
            times = (done + np.arange(rows)) / PAPER_SAMPLE_RATE
            writer.write({"time_s": times, "coil_voltage_V": voltage[:rows], "hall_T": hall[:rows]})
            done += rows
    command = [FEMFIT, "integrate", str(tmp_path / "coil.bin"), "--coil-area", "0.059394", "--method", method]
    begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([*command, "-o", str(tmp_path / "out.bin")], stdout=subprocess.DEVNULL, check=True)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(
        f"\nfemfit integrate {method}, {SAMPLES / 1e6:.0f} million samples from file to file: "
        f"{wall:.0f} s ({cpu:.0f} s of CPU, one core), {SAMPLES / wall / 1e6:.1f} million samples a second; peak "
        f"memory {after.ru_maxrss / 1024:.0f} MB"
    )
    assert (tmp_path / "out.bin").stat().st_size == SAMPLES * 5 * 4
