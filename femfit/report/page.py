"""One page of sections: the frame that every report shares."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from femfit import __version__
from femfit.core.atomic import write_text
from femfit.core.errors import RunDirectoryError
from femfit.report.section import DataTable, Picture, Section

LARGEST_BYTES = 3_000_000


@dataclass(frozen=True)
class Page:
    """A report before it is put into HTML.

    Parameters
    ----------
    title, lead : str
        Heading, and a sentence below it (may be empty).
    paper : str
        What "the paper" is; empty where the page names none.
    """

    title: str
    lead: str
    summary: Sequence[str]
    sections: Sequence[Section]
    paper: str = ""


def render_page(page: Page) -> str:
    """A page as HTML text."""
    from jinja2 import Environment

    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.tests["picture"] = lambda block: isinstance(block, Picture)
    environment.tests["table"] = lambda block: isinstance(block, DataTable)
    folder = files("femfit.report")
    template = environment.from_string((folder / "report.html.j2").read_text(encoding="utf-8"))
    return template.render(page=page, style=(folder / "report.css").read_text(encoding="utf-8"), version=__version__)


def write_page(text: str, path: Path) -> Path:
    """Write a page, completely or not at all.

    Parameters
    ----------
    path : Path
        Of the file; its directory is made if absent.

    Raises
    ------
    RunDirectoryError
        If the file would not stay below 3 MB.
    """
    encoded = text.encode()
    if len(encoded) > LARGEST_BYTES:
        raise RunDirectoryError(
            f"The report must stay below {LARGEST_BYTES / 1e6:g} MB; it has {len(encoded) / 1e6:.2f} MB. Sweep fewer "
            f"points."
        )
    path = Path(path)
    write_text(path, text)
    return path
