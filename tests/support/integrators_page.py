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


def page(told, figures, drifts, pictures):
    """The page with its own prose: what took how long, all ramp rates' figures, many draws' drifts, captions."""
    shown = [f"![{caption}]({name})\n\n{caption}.\n" for name, caption in pictures.items()]
    introduction, _, after = PAGE.read_text("utf-8").partition("\n\nWhat it took: ")
    about_draws = after.partition("\n\n## Pictures")[0].rpartition("|\n\n")[2]
    tables = [*table_lines(figures), *draw_lines(drifts), "", about_draws]
    lines = [introduction, "", told, *tables, "", "## Pictures", "", "At 1 kS/s.", ""]
    return "\n".join([*lines, *shown])


DRAWN = ("cs1", "cs2", "cs1-offset")
DRAWS = "Table 2 over twenty draws: median and largest drift in ppm/s, and how many are above 0.1"
