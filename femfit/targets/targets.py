"""What a model can be exported to: one tuple."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from femfit.core.errors import MissingPartError
from femfit.model.actuator_model import ActuatorModel
from femfit.targets.estimator import export_estimator


@dataclass(frozen=True)
class ExportTarget:
    """One kind of export."""

    name: str
    description: str
    export: Callable[[ActuatorModel, Path], tuple[Path, ...]]


TARGETS: tuple[ExportTarget, ...] = (
    ExportTarget("estimator", "A Python package with filters and simulator that needs numpy alone.", export_estimator),
)


def export_target(name: str) -> ExportTarget:
    """Look up a target.

    Raises
    ------
    MissingPartError
        If there is none of this name.
    """
    for target in TARGETS:
        if target.name == name:
            return target
    known = "; ".join(f"{target.name} ({target.description[:-1]})" for target in TARGETS)
    raise MissingPartError(f"Export target must be one of: {known}; instead received {name!r}.")
