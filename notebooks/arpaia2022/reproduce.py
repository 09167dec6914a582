"""Tables 1 to 3 and Figures 5 to 8 of P. Arpaia et al., Sensors 22 (2022) 182, each by one command.

``python notebooks/arpaia2022/reproduce.py table-1`` (``table-2``, ``table-3``) prints femfit's figures beside the
paper's; ``figure-5`` (to ``figure-8``) writes figure-5.png and so on.

The experiment is synthetic, at 1 kS/s; ``table-1 204800`` takes the paper's rate, as ``docs/integrators.md`` has it.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from arpaia2022.experiment import (
    PAPER_RAMP_RATES,
    Course,
    ExperimentInputs,
    make_course,
    stream_pieces,
    synthesise,
)
from arpaia2022.figures import fields_figure, flat_top_figure, offsets_figure
from arpaia2022.sensors import PAPER_COIL
from arpaia2022.study import (
    PAPER_METHODS,
    Figures,
    experiment_fields,
    experiment_figures,
    paper_inputs,
    table_text,
)
from femfit.integrate.field_of_current import FieldModel
from femfit.integrate.field_of_current import LabRun, identify_field
from femfit.integrate.methods import IntegrationOptions, make_integrator

WHAT = ("table-1", "table-2", "table-3", "figure-5", "figure-6", "figure-7", "figure-8")
LAB = ((10, 32.0, (320.0, 280.0, 240.0, 160.0, 80.0)), (11, 100.0, (320.0, 120.0, 320.0, 200.0)))
"""Seed, ramp rate in A/s and peaks in A of the lab runs that the field model is identified from."""


def course_and_noise(
    ramp_rate: float, sample_rate: float = 1000.0, seed: int = 1
) -> tuple[Course, np.random.Generator]:
    """The experiment at a ramp rate, wandering alike at every sample rate, and the generator of its white noise."""
    wander, noise = np.random.default_rng([seed, round(10 * ramp_rate)]).spawn(2)
    return make_course(paper_inputs(ramp_rate, sample_rate), wander), noise


def field_model() -> FieldModel:
    """What cs2-identified knows of the magnet, from two lab runs at 1 kS/s with a Hall probe."""
    runs = []
    for seed, rate, peaks in LAB:
        inputs = ExperimentInputs(ramp_rate=rate, amplitudes=peaks)
        lab = synthesise(inputs, np.random.default_rng(seed)).after_zero_reading().record
        integrator = make_integrator(IntegrationOptions("cs1-offset", PAPER_COIL), lab)
        runs.append(LabRun(lab.time, lab.current, integrator.advance(integrator.start(), lab)[1].field))
    return identify_field(runs)


def tables(sample_rate: float) -> list[Figures]:
    """Figures of all methods at all ramp rates, from the experiment a second at a time."""
    model, figures = field_model(), []
    for rate in PAPER_RAMP_RATES:
        course, noise = course_and_noise(rate, sample_rate)
        figures += experiment_figures(stream_pieces(course, round(sample_rate), noise), model)
    return figures


def reproduce(what: str, sample_rate: float = 1000.0, folder: Path = Path()) -> str:
    """A table as text, or the name of the picture that was written, which is at 1 kS/s."""
    if what.startswith("table"):
        return table_text(tables(sample_rate), int(what[-1]))
    experiments = {}
    for rate in PAPER_RAMP_RATES:
        course, noise = course_and_noise(rate)
        experiments[rate] = course.piece(0, course.samples, noise)
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
    if len(sys.argv) not in (2, 3) or sys.argv[1] not in WHAT:
        sys.exit(f"Give one of {', '.join(WHAT)}, and perhaps samples a second.")
    print(reproduce(sys.argv[1], *map(float, sys.argv[2:])))
