"""Everything into one HTML file that needs nothing beside it."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from femfit.device.parts import Actuator
from femfit.report.content import ReportContent, picture_point
from femfit.report.embed import png_uri
from femfit.report.field_sample import FieldSample
from femfit.report.offscreen import OffScreenPicture, draw_off_screen
from femfit.report.page import Page, render_page, write_page
from femfit.report.paper import CITATION
from femfit.report.section import Picture, Section, text
from femfit.report.section_actuator import actuator_section
from femfit.report.section_candidates import candidates_section
from femfit.report.section_field import field_section
from femfit.report.section_hall import hall_section
from femfit.report.section_limits import limits_section, provenance_section
from femfit.report.section_loop import loop_section
from femfit.report.section_paper_laws import paper_laws_section
from femfit.report.section_sweep import sweep_section
from femfit.report.summary import summary

Draw = Callable[[Actuator, FieldSample], OffScreenPicture]


def write_report(content: ReportContent, path: Path, draw: Draw = draw_off_screen) -> Path:
    """Write the report.

    Parameters
    ----------
    path : Path
        Of the HTML file; its directory is made if absent.
    draw : callable
        Draws the cut-away, while the other pictures are made.

    Raises
    ------
    RunDirectoryError
        If the file would not stay below 3 MB.
    """
    return write_page(render_report(content, draw), path)


def render_report(content: ReportContent, draw: Draw = draw_off_screen) -> str:
    """The report as HTML text."""
    return render_page(
        Page(
            title=content.actuator.name,
            lead=content.actuator.description,
            summary=summary(content),
            sections=_sections(content, draw),
            paper=CITATION,
        )
    )


def _sections(content: ReportContent, draw: Draw) -> list[Section]:
    sample = content.field
    with ThreadPoolExecutor(1) as background:
        drawing = None if sample is None else background.submit(draw, content.actuator, sample)
        rest = [
            sweep_section(content),
            paper_laws_section(content),
            candidates_section(content),
            hall_section(content),
            loop_section(content),
            limits_section(content),
            provenance_section(content),
        ]
        drawn = None if drawing is None else drawing.result()
    if sample is None or drawn is None:
        head = [actuator_section(content, picture_point(content.actuator, content.fit.model)[0], None)]
    else:
        head = [
            actuator_section(content, sample.distance_m, _cutaway(content.actuator, sample, drawn)),
            field_section(content, sample, None if drawn.image else drawn.how),
        ]
    return [*head, *(section for section in rest if section is not None)]


def _cutaway(actuator: Actuator, sample: FieldSample, drawn: OffScreenPicture) -> Picture | None:
    if drawn.image is None:
        return None
    return Picture(
        "cutaway",
        png_uri(drawn.image),
        f"{actuator.name} with a quarter cut away; flux density on the cut faces, flux lines in the air.",
        text(
            "A quarter cut away: |B| on the cut faces, flux lines coloured by |B|, at d = {} mm and i = {} A. Drawn "
            "by {}.",
            f"{1e3 * sample.distance_m:.4g}",
            f"{sample.current_A:.3g}",
            drawn.how,
        ),
        narrow=True,
    )
