"""The paper's experiment at 204.8 kS/s through files, in pieces; writes docs/integrators.md and its pictures.

Run with ``-m benchmark -s``: 440 million samples, of which 209 million in the slowest experiment; 5 GB of disk.
FEMFIT_BENCHMARK_SAMPLE_RATE makes it coarser, and then nothing is written.
"""

import os
import resource
import time

import numpy as np
import pytest
from arpaia2022.experiment import PAPER_RAMP_RATES, Experiment, stream_pieces
from arpaia2022.figures import fields_figure, flat_top_figure, offsets_figure
from arpaia2022.reproduce import course_and_noise
from arpaia2022.sensors import PAPER_SAMPLE_RATE
from arpaia2022.study import experiment_fields, experiment_figures, study_lines

from femfit.tables.coil_record import open_coil_record
from femfit.tables.record_writer import RecordWriter
from support.integrators_page import PAGE, draws, field_model, page

pytestmark = pytest.mark.benchmark

RATE = float(os.environ.get("FEMFIT_BENCHMARK_SAMPLE_RATE", PAPER_SAMPLE_RATE))
ROWS = round(RATE)  # a second, so that the zero reading ends where a piece does
PICTURES = {
    "integrators-5.png": "Figure 5: offset voltage by ffa1, ffa2 and cs1",
    "integrators-6.png": "Figure 6: offset voltage by ffa1, ffa2 and cs2, with its spikes on the ramps",
    "integrators-7.png": "Figure 7: field by method, magnified from row to row about the flat-tops",
    "integrators-8.png": "Figure 8: the last flat-top at 100 A/s",
}


def write(course, noise, folder):
    """Record and, apart from it, the truth."""
    names, step = ["time_s", "coil_voltage_V", "hall_T", "current_A"], 1.0 / RATE
    with (
        RecordWriter(folder / "coil.f32", names, step) as record,
        RecordWriter(folder / "truth.f32", ["time_s", "field_T", "offset_V"], step) as truth,
    ):
        for piece in stream_pieces(course, ROWS, noise):
            block = piece.record
            record.write(dict(zip(names, (block.time, block.voltage, block.hall, block.current), strict=True)))
            truth.write({"time_s": block.time, "field_T": piece.field, "offset_V": piece.offset})


def read(course, folder):
    """The experiment's pieces from the files; float32 holds the field to 0.06 uT."""
    with (folder / "truth.f32").open("rb") as file:
        for block in open_coil_record(folder / "coil.f32").blocks(ROWS):
            truth = np.fromfile(file, "<f4", 2 * len(block)).reshape(-1, 2).astype(np.float64)
            yield Experiment(course.inputs, block, truth[:, 0], truth[:, 1], course.flat_tops)


def draw():
    """Figures 5 to 8, at 1 kS/s."""
    experiments = {}
    for ramp_rate in PAPER_RAMP_RATES:
        course, noise = course_and_noise(ramp_rate, 1000.0)
        experiments[ramp_rate] = course.piece(0, course.samples, noise)
    blocks = {rate: experiment_fields(experiment) for rate, experiment in experiments.items()}
    figures = (
        offsets_figure(blocks, ("ffa1", "ffa2", "cs1")),
        offsets_figure(blocks, ("cs2", "ffa1", "ffa2")),
        fields_figure(blocks, ("trapezoid", "ffa1", "ffa2", "cs1", "cs2")),
        flat_top_figure(blocks[100.0], experiments[100.0].flat_tops[-1], ("ffa2", "cs1", "cs2")),
    )
    for name, figure in zip(PICTURES, figures, strict=True):
        figure.savefig(PAGE.with_name(name), dpi=110)


def test_the_papers_tables_at_its_own_sample_rate(tmp_path):
    model, figures, told = field_model(), [], []
    for ramp_rate in PAPER_RAMP_RATES:
        course, noise = course_and_noise(ramp_rate, RATE)
        begin = time.process_time()
        write(course, noise, tmp_path)
        middle = time.process_time()
        found = experiment_figures(read(course, tmp_path), model)
        figures += found
        spent = time.process_time() - middle
        told.append(
            f"at {ramp_rate:g} A/s {course.samples / 1e6:.0f} million samples, made in {middle - begin:.0f} s and "
            f"integrated by {len(found)} methods at once in {spent:.0f} s of one core"
        )
        print(f"\n{told[-1]}", flush=True)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print("\n".join(study_lines(figures)), f"\npeak memory {memory:.0f} MB")
    # The filter's covariance; the paper prints 65.
    assert all(row.uncertainty_end == pytest.approx(65.6e-6, abs=0.2e-6) for row in figures if row.method == "cs1")
    if RATE == PAPER_SAMPLE_RATE:
        draw()
        said = f"What it took: {'; '.join(told)}; peak memory {memory:.0f} MB."
        PAGE.write_text(page(said, figures, draws(), PICTURES), encoding="utf-8")
