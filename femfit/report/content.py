"""What a report on an actuator is made of: results that were computed before."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from femfit.core.constants import GRAVITY
from femfit.core.errors import DomainError
from femfit.device.parts import Actuator
from femfit.filters.holding import holding_current
from femfit.fit.result import FitResult
from femfit.fit.rows import FitRows, rows_of_table
from femfit.model.actuator_model import ActuatorModel
from femfit.open_loop.result import OpenLoop
from femfit.report.field_sample import FieldSample
from femfit.simulation.study import ClosedLoopStudy
from femfit.tables.sweep_table import SweepTable


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
    motion: OpenLoop | None = None  # As of :func:`femfit.open_loop.supply.motion_at_supply`
    # The field at :func:`picture_point`, and at :func:`strongest_point`, by which the iron is judged
    field: FieldSample | None = None
    strongest: FieldSample | None = None
    # Whether the loop is still to come: ``femfit run`` writes the page again when it is there
    unfinished: bool = False
    # Steps of the run and their time; files and their SHA-256
    timings_s: tuple[tuple[str, float], ...] = ()
    hashes: tuple[tuple[str, str], ...] = ()

    @cached_property
    def rows(self) -> FitRows | None:
        """The sweep's rows; None without a sweep."""
        if self.fit is not None:
            return self.fit.rows
        if self.sweep is None:
            return None
        mass = None if self.model.motion is None else self.model.motion.mass_kg
        return rows_of_table(self.sweep, mass, GRAVITY)

    @property
    def weight(self) -> float | None:
        """Weight of the moving part in N, where its mass is known."""
        motion = self.model.motion
        return None if motion is None else motion.mass_kg * motion.gravity_m_s2

    @property
    def levitates(self) -> bool:
        """Whether the moving part is meant to be held by the force against its weight."""
        return levitates(self.actuator, self.rows)


def levitates(actuator: Actuator | None, rows: FitRows | None) -> bool:
    """Whether a drawing has a sensor or reference for a body that can hang within the sweep."""
    if actuator is None or rows is None or rows.hanging_weight is None:
        return False
    return actuator.hall is not None or bool(actuator.reference_distances_m)


def picture_point(actuator: Actuator, model: ActuatorModel, rows: FitRows) -> tuple[float, float]:
    """Distance in m and current in A at which the field is drawn.

    A body that is meant to hang is drawn at its first reference distance and its holding current, every other actuator
    at :func:`strongest_point`.
    """
    if levitates(actuator, rows) and model.motion is not None:
        distances = actuator.reference_distances_m or (float(np.median(rows.distances)),)
        try:
            return distances[0], holding_current(model, distances[0])
        except DomainError:
            pass
    return strongest_point(actuator)


def strongest_point(actuator: Actuator) -> tuple[float, float]:
    """Smallest distance in m and largest current in A of the sweep: where iron carries the most flux."""
    axes = actuator.sweep
    return min(axes.distances_m), max(axes.currents_A, key=lambda current: (abs(current), current))
