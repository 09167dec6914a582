"""What the report of a diagnosis is made of: results that were computed before."""

from collections.abc import Sequence
from dataclasses import dataclass

from femfit.core.arrays import FloatArray
from femfit.effects.effect import AddedEffect
from femfit.identify.decision.diagnosis import Diagnosis
from femfit.identify.experiments.suggest import Suggestion
from femfit.identify.readings.observations import Observations
from femfit.identify.readings.place import placed
from femfit.identify.refit.add_result import AddResult
from femfit.model.actuator_model import ActuatorModel
from femfit.tables.measurement import Measurement


@dataclass(frozen=True, eq=False)
class DiagnosisContent:
    """A diagnosis, and what was done about it.

    Parameters
    ----------
    after : array, shape (M,), or None
        Recorded minus what the model predicts with the effects that were added, or that the diagnosis names.
    hashes : tuple of (str, str)
        Files and their SHA-256.
    """

    model: ActuatorModel
    observations: Observations
    diagnosis: Diagnosis
    suggestions: Sequence[Suggestion] = ()
    added: AddResult | None = None
    after: FloatArray | None = None
    source: str = "measurement"
    test_object: str = ""
    notes: str = ""
    hashes: tuple[tuple[str, str], ...] = ()

    @property
    def recorded_motion(self) -> bool:
        """Whether readings are windows of a time series."""
        return "velocity_m_s" in self.observations.covariates

    @property
    def effects_after(self) -> tuple[AddedEffect, ...]:
        """What was added to the model, or what the diagnosis names; none where it names nothing."""
        if self.added is not None:
            return (*self.added.base, *self.added.added)
        explanations = self.diagnosis.explanations
        return tuple(explanations[0].effects) if explanations else ()

    @property
    def sigma(self) -> dict[str, float]:
        """Noise of a single reading, for the channels where it is known."""
        return dict(self.diagnosis.noise_floor)


def content_of(
    data: Measurement | None,
    diagnosis: Diagnosis,
    *,
    suggestions: Sequence[Suggestion] = (),
    added: AddResult | None = None,
    hashes: tuple[tuple[str, str], ...] = (),
) -> DiagnosisContent:
    """The content of a measurement's diagnosis, for :func:`femfit.report.diagnosis_html.write_diagnosis_report`.

    Parameters
    ----------
    data : BenchTable or TimeSeries, or None
        What was measured, needed where something was added; otherwise for what it says of itself.
    hashes : tuple of (str, str)
        Files and their SHA-256.
    """
    observations, after = diagnosis.observations, None
    if added is not None and data is not None:
        after = placed(added.model, data).residual
    elif diagnosis.explanations:
        after = observations.value - observations.predict(diagnosis.explanations[0].effects)
    return DiagnosisContent(
        model=diagnosis.model,
        observations=observations,
        diagnosis=diagnosis,
        suggestions=suggestions,
        added=added,
        after=after,
        hashes=hashes,
        **({} if data is None else {"source": data.source, "test_object": data.test_object, "notes": data.notes}),
    )
