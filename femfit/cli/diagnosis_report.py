"""The HTML report that ``femfit diagnose`` and ``femfit add`` write."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from femfit.identify.decision.diagnose import Examination
    from femfit.identify.refit.add_result import AddResult
    from femfit.model.actuator_model import ActuatorModel
    from femfit.tables.measurement import Measurement


def write_report(
    path: Path,
    model: "tuple[Path, ActuatorModel]",
    data: "tuple[Path, Measurement]",
    examination: "Examination",
    added: "AddResult | None" = None,
    say: Callable[[str], None] = lambda _: None,
) -> None:
    """Write the report of a diagnosis.

    Parameters
    ----------
    path : Path
        Of the HTML file.
    model : (Path, ActuatorModel)
        File and what was read from it.
    data : (Path, BenchTable or TimeSeries)
        File and what was read from it.
    examination : Examination
        Of the two.
    added : AddResult or None
        Where an effect was added.
    say : callable
        Receives what is being done.
    """
    from hashlib import sha256

    from femfit.identify.decision.diagnose import considered_effects
    from femfit.identify.experiments.suggest import suggest_measurements
    from femfit.identify.readings.load import measurement_observations
    from femfit.report.diagnosis_content import content_of
    from femfit.report.diagnosis_html import write_diagnosis_report
    from femfit.tables.measurement import BenchTable

    suggestions = []
    evidence, several = examination.evidence, len(examination.explanations) > 1
    if evidence is not None and several and isinstance(data[1], BenchTable):
        say("Trying measurements")
        suggestions = suggest_measurements(
            model[1], data[1], evidence.noise, examination.explanations, considered_effects()
        )
    say("Writing the report")
    content = content_of(
        model[1],
        data[1],
        measurement_observations(model[1], data[1]),
        examination,
        suggestions=suggestions,
        added=added,
        hashes=tuple((file.name, sha256(file.read_bytes()).hexdigest()) for file in (model[0], data[0])),
    )
    write_diagnosis_report(content, path)
