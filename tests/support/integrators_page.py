"""``docs/integrators.md``: the cells of Tables 1 to 3 of the paper on integrators beside the synthetic experiment's."""

from pathlib import Path

from arpaia2022.experiment import PAPER_RAMP_RATES
from arpaia2022.printed import PAPER
from arpaia2022.reproduce import course_and_noise
from arpaia2022.study import experiment_figures

PAGE = Path(__file__).parents[2] / "docs" / "integrators.md"


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
    OFFSETS: ("µV", printed_offset),
    DRIFTS: ("ppm/s", lambda method, k: f"{1e6 * PAPER[method].drift[k]:.3g}"),
    UNCERTAINTIES: ("µT", lambda method, k: f"{1e6 * PAPER[method].uncertainty_end[k]:.4g}"),
    ERRORS: ("µT", None),
}
"""By title: the unit, and the paper's cell."""


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


DRAWN = ("cs1", "cs2", "cs1-offset")
DRAWS = "Table 2 over twenty draws: median and largest drift in ppm/s, and how many are above 0.1"
