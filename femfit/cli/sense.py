"""``femfit sense``: how well sensors tell the distance without a sensor of position."""

from pathlib import Path
from typing import Annotated, Any

import femfit as ff
from femfit.cli.command import Outcome, command
from femfit.cli.keywords import Keywords

_OPTIONS = Keywords(
    "femfit.simulation.sense:sense",
    "sensors voltage_V=voltage drive test_voltage_V=test-voltage test_frequency_Hz runs rng=seed",
)


@command(
    picture="PNG, SVG or PDF with the motion, the filter's error and its bound.",
    csv="File for time, distance, the filter's error, what it claims, and the bound.",
)
def sense(
    model: Path,
    *,
    options: Annotated[dict[str, Any], _OPTIONS],
) -> Outcome:
    """How well the current tells the distance: error in simulation, and bound.

    Parameters
    ----------
    model : Path
        Model file with circuit, motion and the sensors.
    """
    from femfit.cli.output import status

    with status("Simulating"):
        return Outcome(ff.sense(model, **options))
