"""``docs/integrators.md``: Tables 1 to 3 of the paper on integrators beside the synthetic experiment's.

``python -m pytest -m benchmark -s tests/benchmarks/test_benchmark_paper_tables.py`` writes it and its pictures.
"""

from pathlib import Path

import numpy as np
from arpaia2022.experiment import PAPER_RAMP_RATES, ExperimentInputs, synthesise
from arpaia2022.printed import PAPER
from arpaia2022.reproduce import course_and_noise
from arpaia2022.sensors import PAPER_COIL
from arpaia2022.study import experiment_figures

from femfit.integrate.identified_field import LabRun, identify_field
from femfit.integrate.methods import IntegrationOptions, make_integrator

PAGE = Path(__file__).parents[2] / "docs" / "integrators.md"
MAGNETS = ((10, 32.0, (320.0, 280.0, 240.0, 160.0, 80.0)), (11, 100.0, (320.0, 120.0, 320.0, 200.0)))
"""Seed, ramp rate in A/s and peaks in A of the lab runs that the field model is identified from."""


def field_model():
    """What cs2-identified knows of the magnet, from lab runs at 1 kS/s with a Hall probe."""
    runs = []
    for seed, rate, peaks in MAGNETS:
        inputs = ExperimentInputs(ramp_rate=rate, amplitudes=peaks)
        lab = synthesise(inputs, np.random.default_rng(seed)).after_zero_reading().record
        integrator = make_integrator(IntegrationOptions("cs1-offset", PAPER_COIL), lab)
        runs.append(LabRun(lab.time, lab.current, integrator.advance(integrator.start(), lab)[1].field))
    return identify_field(runs)


def offset_cell(row):
    """Table 1's cell of a method, in uV."""
    if row.method == "trapezoid":
        return "-"
    mean, low, high = (1e6 * value for value in (row.offset_mean, *row.offset_range))
    return f"{mean:.1f}" if row.method == "ffa1" else f"{mean:.1f} [{low:.0f}, {high:.0f}]"


def printed_offset(method, place):
    """The paper's."""
    printed = PAPER[method]
    if printed.offset_mean is None:
        return "-"
    mean = f"{1e6 * printed.offset_mean[place]:.1f}"
    if printed.offset_range is None:
        return mean
    low, high = printed.offset_range[place]
    return f"{mean} [{1e6 * low:.0f}, {1e6 * high:.0f}]"


OFFSETS = "Table 1: offset voltage, mean and range over a second, µV"
DRIFTS = "Table 2: global drift, ppm/s"
UNCERTAINTIES = "Table 3: total uncertainty (18) at the end against cs1, k = 2, µT"
ERRORS = "True rms error on settled flat-tops, µT"
TABLES = {
    OFFSETS: (offset_cell, printed_offset),
    DRIFTS: (lambda row: f"{1e6 * row.drift:.3g}", lambda method, k: f"{1e6 * PAPER[method].drift[k]:.3g}"),
    UNCERTAINTIES: (
        lambda row: f"{1e6 * row.uncertainty_end:.4g}",
        lambda method, k: f"{1e6 * PAPER[method].uncertainty_end[k]:.4g}",
    ),
    ERRORS: (lambda row: f"{1e6 * row.plateau_rms:.3g}", None),
}
"""By title: femfit's cell and the paper's."""


def table_lines(figures):
    """All tables in Markdown, from the figures of all ramp rates."""
    by = {(row.ramp_rate, row.method): row for row in figures}
    methods = list(dict.fromkeys(row.method for row in figures))
    for title, (ours, theirs) in TABLES.items():
        heads = [f"{rate:g} A/s | paper" if theirs else f"{rate:g} A/s" for rate in PAPER_RAMP_RATES]
        yield from ("", f"## {title}", "", f"| method | {' | '.join(heads)} |")
        yield "|---" * (1 + len(heads) * (2 if theirs else 1)) + "|"
        for method in methods:
            cells = []
            for k, rate in enumerate(PAPER_RAMP_RATES):
                cells.append(ours(by[rate, method]))
                if theirs:
                    cells.append(theirs(method, k) if method in PAPER else "")
            yield f"| {method} | {' | '.join(cells)} |"


def printed_cells():
    """femfit's cell by (title, method, ramp rate), as the page has it."""
    found = {}
    for title, (_, theirs) in TABLES.items():
        for method, cells in _rows_under(title):
            found |= {(title, method, rate): cells[(2 if theirs else 1) * k] for k, rate in enumerate(PAPER_RAMP_RATES)}
    return found


def printed_draws():
    """The page's cell of the draws by (method, ramp rate)."""
    return {
        (method, rate): cell
        for method, cells in _rows_under(DRAWS)
        for rate, cell in zip(PAPER_RAMP_RATES, cells, strict=True)
    }


def _rows_under(title):
    """Method and cells of each row of a table."""
    under = PAGE.read_text("utf-8").split(f"## {title}\n")[1].split("\n## ")[0]
    for line in under.splitlines():
        method, *cells = (cell.strip() for cell in line.strip("|").split("|"))
        if line.startswith("| ") and method != "method":
            yield method, cells


def draws(count=20, sample_rate=200.0):
    """Drifts of Table 2 by (method, ramp rate) over as many draws of what wanders; they do not depend on the rate."""
    found = {}
    for ramp_rate in PAPER_RAMP_RATES:
        for seed in range(1, count + 1):
            course, noise = course_and_noise(ramp_rate, sample_rate, seed)
            for row in experiment_figures([course.piece(0, course.samples, noise)]):
                if row.method in DRAWN:
                    found.setdefault((row.method, ramp_rate), []).append(row.drift)
    return found


def draw_lines(drifts):
    """The draws in Markdown."""
    yield from ("", f"## {DRAWS}", "", f"| method | {' | '.join(f'{rate:g} A/s' for rate in PAPER_RAMP_RATES)} |")
    yield "|---" * (1 + len(PAPER_RAMP_RATES)) + "|"
    for method in DRAWN:
        cells = []
        for rate in PAPER_RAMP_RATES:
            values = 1e6 * np.array(drifts[method, rate])
            cells.append(f"{np.median(values):.3f}, {values.max():.3f}, {int((values > 0.1).sum())}")
        yield f"| {method} | {' | '.join(cells)} |"
    yield from ("", ABOUT_DRAWS)


def page(told, figures, drifts, pictures):
    """The page: what took how long, the figures of all ramp rates, the drifts of many draws, and caption by picture."""
    shown = [f"![{caption}]({name})\n\n{caption}.\n" for name, caption in pictures.items()]
    lines = [INTRODUCTION, told, *table_lines(figures), *draw_lines(drifts), "", "## Pictures", "", "At 1 kS/s.", ""]
    return "\n".join([*lines, *shown])


DRAWN = ("cs1", "cs2", "cs1-offset")
DRAWS = "Table 2 over twenty draws: median and largest drift in ppm/s, and how many are above 0.1"
ABOUT_DRAWS = """A filter with one state lags by offset x time constant / area: 6.3 µT for each µV with the paper's
weights (0.37 s). So an offset that differs by 7 to 11 µV between the first flat-top and the last one makes 0.1 ppm/s,
and offsets that range over 35 µV do that in some draws. Neither another settling (a flat-top's beginning has the eddy
transient) nor weights from the record's own noise (0.6 s) end it; the offset as a second state does."""


INTRODUCTION = """# Drift-free integration beside the paper

P. Arpaia et al., *Drift-Free Integration in Inductive Magnetic Field Measurements Achieved by Kalman Filtering*,
Sensors 22 (2022) 182, cycled a magnet between 0 and 320 A and integrated the voltage of a coil of 0.059394 m² at
204.8 kS/s. Their records are not published. Here the experiment is synthetic, at the same rate: written to raw float32
files piece by piece, truth apart, and integrated from there. This page is written by
`python -m pytest -m benchmark -s tests/benchmarks/test_benchmark_paper_tables.py`; a test makes the experiment again at
1 kS/s with the same wander, and compares. One table or figure at 1 kS/s, in a minute:
`python notebooks/arpaia2022/reproduce.py table-1` (`table-2`, `table-3`, `figure-5`, `figure-6`, `figure-7`,
`figure-8`).

**Put in:** the cycles, remanence, eddy transient, coil, mean and limits of the offset voltage (all the paper's); how
offset, supply and Hall probe wander within (assumed: 1/f with 4 µV, 1 mA and 1 µT rms); the distance of the true field
from I / g (0.26 mT at the top). So these are inputs: the offset's mean and range in Table 1; the first three rows of
Tables 2 and 3; the row of cs2 in Table 3. **Found:** the lags and variances of the filters: the row of cs1 in Table 3,
how far wandering offsets move cs1 and cs2 in Table 2, the spikes of cs2 in Table 1, and all of cs1-offset and
cs2-identified, which the paper does not have. The paper's cs1 and cs2, with the field as their one state, stand in
`notebooks/arpaia2022`; `femfit integrate` has the others, and as cs2 a filter with the ratio I / g that estimates the
offset voltage too. (18) takes cs1 as the truth, whose own lag cs1-offset is charged with:
the last table has the true errors. (17) starts 30 s after the first flat-top's begin; from its beginning, as printed, a
perfect sensor would show 0.24 ppm/s, the eddy transient.
"""
