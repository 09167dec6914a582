"""``write_report``: one page for whatever femfit found out, as one HTML file that loads nothing."""

from collections.abc import Iterable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from femfit.core.errors import FemfitError
from femfit.core.files import PAGE, path_of, require_outputs
from femfit.fit.build import fit_model
from femfit.fit.result import FitResult
from femfit.heat.find_temperatures import temperatures_at_supply
from femfit.identify.before_after import AddResult
from femfit.identify.compare import Comparison
from femfit.identify.decision.diagnose import Diagnosis
from femfit.model.actuator_model import ActuatorModel
from femfit.model.json_file import read_model
from femfit.report.actuator_report import draw_figures, render_report
from femfit.report.bench_report import render_added, render_comparison, render_diagnosis
from femfit.report.page import Place, ReportContent, drawing_of, picture_point, strongest_point, write_page
from femfit.simulation.open_loop import motion_at_supply
from femfit.tables.sweep_table import SweepTable, read_sweep_table

if TYPE_CHECKING:
    from femfit.report.field_sample import FieldSample

MODEL_FILE = "model.json"


def write_report(result: Any, path: str | Path) -> Path:
    """Write the report on a result.

    Parameters
    ----------
    result : str, Path, ActuatorModel, SweepTable, FitResult, Comparison, Diagnosis or AddResult
        A run directory or a model file, or what a function of the library returned.
    path : str or Path
        HTML file; its directory is made if absent.

    Raises
    ------
    FemfitError
        If there is no report on such a result.
    RunDirectoryError
        If the file would not stay below 3 MB.

    Examples
    --------
    >>> import femfit as ff
    >>> ff.write_report("runs/rig", "rig.html").name
    'rig.html'
    """
    require_outputs([], (path_of(path, "The report"), PAGE))
    return write_page(_page(result), path)


def _page(result: Any) -> str:
    if isinstance(result, Comparison):
        return render_comparison(result)
    if isinstance(result, AddResult):
        return render_added(result)
    if isinstance(result, Diagnosis):
        return render_diagnosis(result)
    if not isinstance(result, ReportContent):
        content = _content(result)
        heat = None if content.actuator is None else temperatures_at_supply(content.actuator)
        result = replace(content, motion=motion_at_supply(content.model), heat=heat)
    return render_report(result, draw_figures(result))


def _content(result: Any) -> ReportContent:
    if isinstance(result, str | Path):
        place = Path(result)
        if not place.is_dir():
            return ReportContent(read_model(place), hashes=hashes([place]))
        table, file = read_sweep_table(place), place / MODEL_FILE
        model = read_model(file) if file.is_file() else None
        present = [f for f in (place / "sweep.parquet", file) if f.is_file()]
        return _table_content(table, model, hashes(present))
    if isinstance(result, ActuatorModel):
        return ReportContent(result)
    if isinstance(result, FitResult):
        return ReportContent(result.model, fit=result)
    if isinstance(result, SweepTable):
        return _table_content(result, None, ())
    raise FemfitError(
        "A report can be written on a run directory, a model, a sweep, a fit, a comparison, a diagnosis or added "
        f"effects; instead received {type(result).__name__}."
    )


def _table_content(
    table: SweepTable, model: ActuatorModel | None, hashes: tuple[tuple[str, str], ...]
) -> ReportContent:
    """A sweep with its drawing, where its manifest holds it, and its model, which is fitted where there is none."""
    actuator = drawing_of(table)
    fit = fit_model(table) if model is None else None
    model = fit.model if fit is not None else model
    assert model is not None  # noqa: S101 - fitted above
    content = ReportContent(model, actuator, table, fit, hashes=hashes)
    return content if actuator is None else with_field(content)


def with_field(content: ReportContent) -> ReportContent:
    """The content of a drawing and its sweep with the field solved at the points that a report shows."""
    from femfit.report.field_sample import solve_point

    actuator, rows = content.actuator, content.rows
    assert actuator is not None  # noqa: S101
    assert rows is not None  # noqa: S101
    points = picture_point(content, actuator, rows), strongest_point(actuator)
    samples: dict[Place, FieldSample] = {p: solve_point(actuator, *p).sample for p in dict.fromkeys(points)}
    return replace(content, field=samples[points[0]], strongest=samples[points[1]])


def hashes(files: Iterable[Path]) -> tuple[tuple[str, str], ...]:
    """Names and SHA-256 of files."""
    return tuple((file.name, sha256(file.read_bytes()).hexdigest()) for file in files)
