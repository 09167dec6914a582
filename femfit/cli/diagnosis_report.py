"""The HTML report that ``femfit diagnose`` writes."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from femfit.identify.decision.diagnosis import Diagnosis
    from femfit.tables.measurement import Measurement


def write_report(
    path: Path,
    files: tuple[Path, Path],
    measured: "Measurement",
    diagnosis: "Diagnosis",
    say: Callable[[str], None] = lambda _: None,
) -> None:
    """Write the report of a diagnosis on the files of a model and of a measurement."""
    from femfit.identify.experiments.suggest import suggest
    from femfit.report.bench_report import render_diagnosis
    from femfit.report.page import write_page
    from femfit.report.write import hashes

    advice = suggest(diagnosis.model, measured, diagnosis, progress=say)
    say("Writing the report")
    page = render_diagnosis(diagnosis, measured, suggestions=advice.suggestions, hashes=hashes(files))
    write_page(page, path)
