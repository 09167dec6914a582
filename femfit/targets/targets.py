"""What a model can be exported to: one tuple, and the one function that does it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from femfit.core.errors import UsageError
from femfit.core.files import path_of
from femfit.core.results import Result
from femfit.core.text import amount, counted
from femfit.estimate.kalman_filter import FilterKind
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.targets.c_code import STARTS, Real, export_c
from femfit.targets.estimator import export_estimator


@dataclass(frozen=True, eq=False, repr=False)
class Export(Result):
    """What was exported: the target's name, the directory and the files in it.

    Examples
    --------
    >>> import femfit as ff
    >>> done = ff.export("model.json", "build")
    >>> done.files[-1].is_file()
    True
    """

    target: str
    directory: Path
    files: tuple[Path, ...]
    # By how much the distance in single precision differs from that in double along a simulated motion, None in double;
    # and from how many of its starts single precision loses its covariance
    single_precision_m: float | None = None
    single_precision_lost: int = 0

    def __str__(self) -> str:
        files = counted(len(self.files), "file")
        done = f"{self.directory}: {self.target}, {files}; read {self.directory / 'README.md'}"
        if self.single_precision_m is None:
            return done
        done += f"\nSingle precision is off by {amount(self.single_precision_m, 'm')} along a simulated motion."
        if lost := self.single_precision_lost:
            done += f"\nIt loses its covariance from {lost} of {len(STARTS)} starts: take --real double."
        return done

    @property
    def data(self) -> dict[str, Any]:
        """What programs read; the files relative to the directory."""
        files = [file.relative_to(self.directory) for file in self.files]
        facts = {"target": self.target, "directory": self.directory, "files": files}
        single = {name: value for name, value in vars(self).items() if name.startswith("single_precision")}
        return facts if self.single_precision_m is None else facts | single


TARGETS = {
    "estimator": "Filters and simulator as one file of plain Python.",
    "c": "A filter as C99 for a microcontroller, with a program that follows a record.",
}


def export(
    model: ActuatorModel | str | Path,
    directory: str | Path,
    *,
    to: str = "estimator",
    filter: str = "ukf",  # noqa: A002  as the command's option
    real: str = "double",
    sensors: Sequence[str] | None = None,
) -> Export:
    """Export a model to something that runs without femfit.

    Parameters
    ----------
    model : ActuatorModel or path
        The model, or its file.
    directory : path
        Absent, empty, or an earlier export, whose files are replaced.
    to : str
        Kind of export: estimator (filters and simulator as one file of Python), or c (a filter in C99).
    filter : str
        Kalman filter of C: ukf (unscented) or ekf (extended); the file of Python has both.
    real : str
        Precision of C: double, or float where the hardware has that alone; what that costs along a simulated motion is
        said.
    sensors : sequence of str or None
        Sensors that the filter reads; the Hall element by default, or all where there is none.

    Raises
    ------
    UsageError
        If there is no such target, filter or precision.
    MissingPartError
        If the model lacks what it needs.

    Examples
    --------
    >>> import femfit as ff
    >>> print(ff.export("model.json", "build"))
    build: estimator, 4 files; read build/README.md
    """
    options = {"target": (to, tuple(TARGETS)), "filter": (filter, ("ukf", "ekf")), "real": (real, ("double", "float"))}
    for what, (value, allowed) in options.items():
        if value not in allowed:
            targets = "; ".join(f"{name} ({text[:-1]})" for name, text in TARGETS.items())
            wanted = targets if what == "target" else " or ".join(allowed)
            raise UsageError(f"Export {what} must be one of: {wanted}; instead received {value!r}.")
    place, read = path_of(directory, "The directory of an export"), model_of(model)
    if to == "estimator":
        return Export(to, place, export_estimator(read, place, sensors))
    files, single = export_c(read, place, sensors, cast("FilterKind", filter), cast("Real", real))
    return Export(to, place, files, *(single or ()))
