"""Tables 1 to 3 and Figures 5 to 8 of P. Arpaia et al., Sensors 22 (2022) 182, each by one command.

``python notebooks/arpaia2022/reproduce.py table-1`` (``table-2``, ``table-3``) prints femfit's figures beside the
paper's; ``figure-5`` (to ``figure-8``) writes figure-5.png and so on.

The experiment is synthetic, at 1 kS/s; ``docs/integrators.md`` has the same at the paper's 204.8 kS/s.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from arpaia2022.experiment import PAPER_RAMP_RATES, Course, make_course
from arpaia2022.figures import fields_figure, flat_top_figure, offsets_figure
from arpaia2022.study import PAPER_METHODS, experiment_fields, experiment_figures, paper_inputs, table_text

WHAT = ("table-1", "table-2", "table-3", "figure-5", "figure-6", "figure-7", "figure-8")


def course_and_noise(
    ramp_rate: float, sample_rate: float = 1000.0, seed: int = 1
) -> tuple[Course, np.random.Generator]:
    """The experiment at a ramp rate, wandering alike at every sample rate, and the generator of its white noise."""
    wander, noise = np.random.default_rng([seed, round(10 * ramp_rate)]).spawn(2)
    return make_course(paper_inputs(ramp_rate, sample_rate), wander), noise


def reproduce(what: str, folder: Path = Path()) -> str:
    """A table as text, or the name of the picture that was written."""
    experiments = {}
    for rate in PAPER_RAMP_RATES:
        course, noise = course_and_noise(rate)
        experiments[rate] = course.piece(0, course.samples, noise)
    if what.startswith("table"):
        figures = [row for experiment in experiments.values() for row in experiment_figures([experiment])]
        return table_text(figures, int(what[-1]))
    fields = {rate: experiment_fields(experiment) for rate, experiment in experiments.items()}
    if what == "figure-5":
        figure = offsets_figure(fields, ("ffa1", "ffa2", "cs1"))
    elif what == "figure-6":
        figure = offsets_figure(fields, ("cs2", "ffa1", "ffa2"))
    elif what == "figure-7":
        figure = fields_figure(fields, PAPER_METHODS)
    else:
        figure = flat_top_figure(fields[100.0], experiments[100.0].flat_tops[-1], ("ffa2", "cs1", "cs2"))
    path = folder / f"{what}.png"
    figure.savefig(path, dpi=110)
    return str(path)


if __name__ == "__main__":
    if len(sys.argv) != 2 or sys.argv[1] not in WHAT:
        sys.exit(f"Give one of {', '.join(WHAT)}.")
    print(reproduce(sys.argv[1]))
