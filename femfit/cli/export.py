"""``femfit export``: a model file to something that runs without femfit."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import femfit as ff
from femfit.cli.command import OUTPUT, Outcome, Writes, command, names_of
from femfit.core.files import MODEL


@command()
def export(
    model: Path,
    *,
    to: str = "estimator",
    kind: Annotated[str, Parameter(name="--filter")] = "ukf",
    real: str = "double",
    sensors: str | None = None,
    output: Annotated[Path, OUTPUT, Writes(MODEL, "model.json")],
) -> Outcome:
    """Export a model.

    Parameters
    ----------
    model : Path
        Model file.
    to : str
        Kind of export: estimator (filters and simulator as one file of Python), or c (a filter in C99).
    kind : str
        Kalman filter of C: ukf (unscented) or ekf (extended).
    real : str
        Precision of C: double, or float where the hardware has that alone.
    sensors : str
        Sensors that the filter reads, with commas; default: the Hall element, or all where there is none.
    output : Path
        Directory that is absent, empty, or an earlier export.
    """
    return Outcome(ff.export(model, output, to=to, filter=kind, real=real, sensors=names_of(sensors) or None))
