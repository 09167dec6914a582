"""How fast and in how much memory a coil record is filtered; run with ``-m benchmark -s``.

The paper's longest record: 1,100 s at 204.8 kS/s, 225 million samples of voltage and Hall probe, 1.8 GB as raw float32.
FEMFIT_BENCHMARK_SAMPLES makes it shorter.
"""

import os
import subprocess
import time

import numpy as np
import pytest
from arpaia2022.sensors import PAPER_SAMPLE_RATE

from support.command import FEMFIT
from support.timed_sweep import processor_seconds

pytestmark = pytest.mark.benchmark

SAMPLES = int(os.environ.get("FEMFIT_BENCHMARK_SAMPLES", "225280000"))
BLOCK = 2**18


@pytest.mark.parametrize("method", ["ffa2", "cs1-offset"])
def test_the_whole_command(method, tmp_path):
    # Voltage and Hall probe at rest in 1 T
    rows = (7e-6, 1.0) + (1.6e-5, 1.6e-4) * np.random.default_rng(0).normal(size=(BLOCK, 2))
    with (tmp_path / "coil.bin").open("wb") as file:
        for _ in range(SAMPLES // BLOCK):
            rows.astype("<f4").tofile(file)
    side = f'sample_rate_Hz = {PAPER_SAMPLE_RATE}\ncolumns = ["coil_voltage_V", "hall_T"]\n'
    (tmp_path / "coil.toml").write_text(side)
    command = [FEMFIT, "integrate", str(tmp_path / "coil.bin"), "--coil-area", "0.059394", "--method", method]
    begin = time.perf_counter()
    done, cpu = processor_seconds(
        lambda: subprocess.run([*command, "-o", str(tmp_path / "out.parquet")], stdout=subprocess.DEVNULL, check=True)
    )
    wall = time.perf_counter() - begin
    print(
        f"\nfemfit integrate {method}, {SAMPLES / 1e6:.0f} million samples from file to file: "
        f"{wall:.0f} s ({cpu:.0f} s of CPU, one core), {SAMPLES / wall / 1e6:.1f} million samples a second"
    )
    assert done.returncode == 0
