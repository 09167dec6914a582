"""What a report is made of: results that were computed before."""

from dataclasses import dataclass

from femfit.core.errors import DomainError
from femfit.device.parts import Actuator
from femfit.filters.theory import holding_current
from femfit.fit.law_fit import LawFit
from femfit.fit.result import FitResult
from femfit.model.actuator_model import ActuatorModel
from femfit.report.field_sample import FieldSample
from femfit.simulation.study import ClosedLoopStudy
from femfit.tables.sweep_table import SweepTable


@dataclass(frozen=True, eq=False)
class ReportContent:
    """Results of one actuator.

    Parameters
    ----------
    fit : FitResult
        Of all laws: candidates, co-energy, Hall characteristic.
    no_study : str
        Why there is none, as the error said.
    field : FieldSample or None
        From :func:`femfit.report.field_sample.sample_field` at :func:`picture_point`.
    timings_s : tuple of (str, float)
        Steps of the run and the time they took.
    hashes : tuple of (str, str)
        Files of the run and their SHA-256.
    """

    actuator: Actuator
    sweep: SweepTable
    fit: FitResult
    study: ClosedLoopStudy | None = None
    no_study: str = ""
    field: FieldSample | None = None
    timings_s: tuple[tuple[str, float], ...] = ()
    hashes: tuple[tuple[str, str], ...] = ()

    @property
    def weight(self) -> float | None:
        """Weight of the moving part in N, where its mass is known."""
        return self.fit.rows.weight

    @property
    def why_no_loop(self) -> str:
        """A sentence on why there is no study."""
        if self.actuator.hall is None:
            return "this actuator has no Hall element, from which the paper's loop takes its distance."
        return self.no_study or "it was not asked for."

    def law(self, name: str) -> LawFit | None:
        """The fit of a candidate by its name; None where it was not fitted."""
        if self.fit.ranking is None:
            return self.fit.law if self.fit.law is not None and self.fit.law.law.name == name else None
        return next((c.fit for c in self.fit.ranking.candidates if c.law.name == name), None)


def picture_point(actuator: Actuator, model: ActuatorModel) -> tuple[float, float]:
    """Where the field is drawn: the first reference distance at its holding current.

    Returns
    -------
    distance, current : float
        In m and A; without a reference the middle of the distances, without a holding current half the largest one.
    """
    axes = actuator.sweep
    middle = 0.5 * (axes.distances_m[0] + axes.distances_m[-1])
    distance = actuator.reference_distances_m[0] if actuator.reference_distances_m else middle
    if model.motion is not None:
        try:
            return distance, holding_current(model, distance)
        except DomainError:
            pass
    return distance, 0.5 * axes.currents_A[-1]
