"""What a user can say about a FEMM model where the file does not say it.

What is said while a FEMM model is imported: problems, which refuse it, and findings, which come with the result.
"""

import math
from dataclasses import dataclass, field
from typing import Any, Literal

from femfit.core.errors import FemFileError
from femfit.core.results import Finding
from femfit.device.read_sweep import axis_values
from femfit.device.schema import MAX_AXIS_POINTS, RangeEntry
from femfit.tables.findings import finding

MIN_ARC_DEGREES, MAX_ARC_DEGREES = 0.1, 30.0
LARGEST_VALUE = 1e5
"""Of a distance in mm or a current in A, as in actuator files."""

MoverSide = Literal["auto", "above", "below"]


@dataclass(frozen=True)
class FemOptions:
    """Choices and values that a ``.fem`` file does not hold, as the command's options of the same names say them.

    Moving blocks are named by their material, moving bodies by the number of one of their block labels; the face's
    height is in the file's z; the file's own point is added to
    the ascending axes of the sweep.
    """

    moving_groups: tuple[int, ...] = ()
    moving_blocks: tuple[str, ...] = ()
    moving_labels: tuple[int, ...] = ()
    circuits: tuple[str, ...] = ()
    mover_side: MoverSide = "auto"
    face_mm: float | None = None
    distances_mm: tuple[float, ...] = ()
    currents_A: tuple[float, ...] = ()
    mass_g: float | None = None
    density_g_per_cm3: float | None = None
    resistance_ohm: float | None = None
    wire_diameter_mm: float | None = None
    arc_degrees: float = 3.0
    name: str | None = None

    def __post_init__(self) -> None:
        problems = [
            f"--{name.replace('_', '-')} must be a positive number; instead received {value:g}."
            for name in ("mass_g", "density_g_per_cm3", "resistance_ohm", "wire_diameter_mm")
            if (value := getattr(self, name)) is not None and not 0.0 < value < math.inf
        ]
        if not MIN_ARC_DEGREES <= self.arc_degrees <= MAX_ARC_DEGREES:
            problems.append(
                f"--arc-degrees must lie between {MIN_ARC_DEGREES:g} and {MAX_ARC_DEGREES:g}; "
                f"instead received {self.arc_degrees:g}."
            )
        if self.face_mm is not None and not math.isfinite(self.face_mm):
            problems.append(f"--face-mm must be a height; instead received {self.face_mm:g}.")
        if problems:
            raise FemFileError("a model with these options", problems)


def axis_option(text: str | None, option: str) -> tuple[float, ...]:
    """The values of an axis as typed: ``start:stop:step`` with both ends, or numbers separated by commas."""
    if text is None:
        return ()
    try:
        numbers = [float(word) for word in text.replace(":", ",").split(",")]
    except ValueError:
        numbers = []
    stepped = text.count(":") == 2 and "," not in text and len(numbers) == 3
    usable = numbers and all(abs(number) <= LARGEST_VALUE for number in numbers) and (":" not in text or stepped)
    if not usable or len(numbers) > MAX_AXIS_POINTS or (stepped and numbers[2] <= 0):
        raise FemFileError(
            f"a model with {option} {text[:40]!r}",
            [f"{option} must be start:stop:step with a positive step, or numbers separated by commas."],
        )
    problems: list[str] = []
    axis = RangeEntry(start=numbers[0], stop=numbers[1], step=numbers[2]) if stepped else sorted(set(numbers))
    values = axis_values(axis, option, problems)
    if problems:
        raise FemFileError(f"a model with {option} {text[:40]!r}", problems)
    return values


@dataclass(frozen=True)
class Notes:
    """Filled by the steps of an import, each in its turn."""

    problems: list[str] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)

    def say(self, key: str, /, **facts: Any) -> None:
        """Remark on the model by a key of ``findings.toml``; an error refuses it, when everything was looked at."""
        remark = finding(key, **facts)
        if remark.severity == "error":
            self.problems.append(str(remark))
        else:
            self.findings.append(remark)
