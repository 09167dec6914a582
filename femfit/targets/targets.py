"""What a model can be exported to: one tuple, and the one function that does it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from femfit.core.errors import UsageError
from femfit.core.files import path_of
from femfit.core.results import Printed
from femfit.core.text import counted
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import model_of
from femfit.targets.estimator import export_estimator


@dataclass(frozen=True)
class ExportTarget:
    """One kind of export."""

    name: str
    description: str
    export: Callable[[ActuatorModel, Path], tuple[Path, ...]]


@dataclass(frozen=True, eq=False, repr=False)
class Export(Printed):
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

    def __str__(self) -> str:
        example = self.directory / "example.py"
        return f"{self.directory}: {self.target}, {counted(len(self.files), 'file')}; try python {example}"

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready; the files relative to the directory."""
        files = [str(file.relative_to(self.directory)) for file in self.files]
        return {"target": self.target, "directory": str(self.directory), "files": files}


TARGETS: tuple[ExportTarget, ...] = (
    ExportTarget("estimator", "A Python package with filters and simulator that needs numpy alone.", export_estimator),
)


def export(model: ActuatorModel | str | Path, directory: str | Path, *, to: str = "estimator") -> Export:
    """Export a model to something that runs without femfit.

    Parameters
    ----------
    model : ActuatorModel or path
        The model, or its file.
    directory : path
        Absent, empty, or an earlier export, whose files are replaced.
    to : str
        Name of one of :data:`TARGETS`.

    Raises
    ------
    UsageError
        If there is no such target.
    MissingPartError
        If the model lacks what it needs.

    Examples
    --------
    >>> import femfit as ff
    >>> print(ff.export("model.json", "build"))
    build: estimator, ... files; try python build/example.py
    """
    target = next((target for target in TARGETS if target.name == to), None)
    if target is None:
        known = "; ".join(f"{target.name} ({target.description[:-1]})" for target in TARGETS)
        raise UsageError(f"Export target must be one of: {known}; instead received {to!r}.")
    place = path_of(directory, "The directory of an export")
    return Export(target.name, place, target.export(model_of(model), place))
