"""A page from a template: the words stand in ``templates/``, the numbers come from the rooms below.

A report on an actuator is made of results that were computed before.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from femfit import __version__
from femfit.core.errors import DomainError, RunDirectoryError
from femfit.core.files import write_text
from femfit.core.numerics import GRAVITY
from femfit.core.text import counted
from femfit.device.load import actuator_from_record
from femfit.device.parts import Actuator
from femfit.estimate.holding import holding_currents
from femfit.fit.result import FitResult
from femfit.fit.rows import FitRows, rows_of_table
from femfit.heat.find_temperatures import Temperatures
from femfit.model.actuator_model import ActuatorModel
from femfit.report.field_sample import FieldSample
from femfit.report.model_figures import SeveralCircuits, Supplied, SweepGrid, at_supply, several_circuits, sweep_grid
from femfit.report.style import (
    at_currents,
    formula_markup,
    p_value,
    percent,
    plain,
    quantity,
    significant,
    words,
)
from femfit.simulation.open_result import OpenLoop
from femfit.simulation.summary import ClosedLoopStudy
from femfit.tables.measurement import channel_words
from femfit.tables.sweep_table import SweepTable

if TYPE_CHECKING:
    from jinja2 import Environment


LARGEST_BYTES = 3_000_000
"""A report is one file that can be sent by mail."""


def render(template: str, facts: Mapping[str, Any], figures: Mapping[str, str]) -> str:
    """Fill a template with numbers and with the data URIs of pictures by name."""
    return _environment().get_template(template).render(facts, figures=figures)


@cache
def _environment() -> "Environment":
    """The templates, with the numbers' filters."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("femfit.report"), autoescape=True, lstrip_blocks=True, undefined=StrictUndefined
    )
    functions = (quantity, percent, plain, significant, at_currents, p_value, counted)
    filters: dict[str, Callable[..., Any]] = {
        "part": lambda name: words("loop", name),
        "mm": lambda metres, digits=4: plain(1e3 * metres, digits),
        "words": lambda name: str(name).replace("_", " "),
        "amperes": lambda current: f"{plain(current)} A",
        "wordy": lambda cells: (str(cells[0]).replace("_", " "), *cells[1:]),
        "formula": formula_markup,
        "channel": channel_words,
    }
    environment.filters |= filters | {function.__name__: function for function in functions}
    templates = files("femfit.report") / "templates"
    environment.globals |= {
        "version": __version__,
        "style": (templates / "report.css").read_text(encoding="utf-8"),
        "script": (templates / "report.js").read_text(encoding="utf-8"),
    }
    return environment


def write_page(text: str, path: str | Path) -> Path:
    """Write a page, completely or not at all; its directory is made if absent."""
    encoded = text.encode()
    if len(encoded) > LARGEST_BYTES:
        raise RunDirectoryError(
            f"The report must stay below {LARGEST_BYTES / 1e6:g} MB; it has {len(encoded) / 1e6:.2f} MB. Sweep fewer "
            f"points."
        )
    write_text(path, text)
    return Path(path)


Place: TypeAlias = tuple[float, float | tuple[float, ...]]
"""Distance in m and current in A; of several circuits one current each."""


@dataclass(frozen=True)
class ReportContent:
    """Results on one actuator; every part but the model may be absent, and its chapter is then left out."""

    # The model that the report describes; with a fit to all laws, the co-energy rather than the recommended law
    model: ActuatorModel
    actuator: Actuator | None = None
    sweep: SweepTable | None = None
    fit: FitResult | None = None
    study: ClosedLoopStudy | None = None
    no_study: str = ""  # Why the loop was not closed, as the error said
    motion: OpenLoop | None = None  # As of :func:`femfit.simulation.open_loop.motion_at_supply`
    heat: Temperatures | None = None  # As of :func:`femfit.heat.find_temperatures.temperatures_at_supply`
    # The field at :func:`picture_point`, and at :func:`strongest_point`, by which the iron is judged
    field: FieldSample | None = None
    strongest: FieldSample | None = None
    hashes: tuple[tuple[str, str], ...] = ()  # Files and their SHA-256
    pictures: tuple[tuple[str, str], ...] = ()  # Those that are drawn already: names and data URIs

    @cached_property
    def rows(self) -> FitRows | None:
        """The sweep's rows; None without a sweep."""
        if self.fit is not None:
            return self.fit.rows
        if self.sweep is None:
            return None
        mass = None if self.model.motion is None else self.model.motion.mass_kg
        return rows_of_table(self.sweep, mass, GRAVITY, self.model.kind)

    @cached_property
    def grid(self) -> SweepGrid | None:
        """The sweep over its current and distance; several circuits have no such grid."""
        return None if self.rows is None or self.rows.several else sweep_grid(self.rows)

    @cached_property
    def feeds(self) -> tuple[Supplied, ...]:
        """The force with a cold and a warm coil at the supply; empty without a circuit, and for several."""
        return at_supply(self.model, self.heat)

    @cached_property
    def together(self) -> SeveralCircuits | None:
        """What several circuits do together; None for one."""
        return several_circuits(self.model) if len(self.model.current_names) > 1 else None

    @property
    def weight(self) -> float | None:
        """Weight of the moving part in N, where its mass is known."""
        motion = self.model.motion
        return None if motion is None else motion.mass_kg * motion.gravity_m_s2


def hangs(actuator: Actuator | None, rows: FitRows | None) -> bool:
    """Whether a drawing has a sensor or reference for a body that can hang within the sweep."""
    if actuator is None or rows is None or rows.hanging_weight is None:
        return False
    return actuator.hall is not None or bool(actuator.reference_distances_m)


def drawing_of(table: SweepTable) -> Actuator | None:
    """The drawing that was swept; None where the table's manifest does not hold it."""
    inputs = table.manifest.get("inputs")
    return None if inputs is None else actuator_from_record(inputs, table.manifest.get("name", "the sweep"))


def picture_point(content: ReportContent, actuator: Actuator, rows: FitRows) -> Place:
    """Distance in m and current in A, or one a circuit, at which the field is drawn.

    A body that is meant to hang is drawn at its first reference distance and its holding current, every other actuator
    at :func:`strongest_point`.
    """
    if hangs(actuator, rows) and content.model.motion is not None:
        distances = actuator.reference_distances_m or (float(np.median(rows.distances)),)
        try:
            return distances[0], holding_currents(content.model, distances[0])[0]
        except DomainError:
            pass
    return strongest_point(actuator)


def strongest_point(actuator: Actuator) -> Place:
    """Shortest distance that the body can have in m and largest currents in A: where iron carries the most flux."""
    axes = actuator.sweep
    largest = [max(each, key=lambda i: (abs(i), i)) for each in (axes.currents_A, *axes.further_A)]
    nearest = max(min(axes.distances_m), actuator.mechanics.ends[0])
    return nearest, tuple(largest) if axes.further_A else largest[0]
