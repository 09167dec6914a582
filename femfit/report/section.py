"""What a section of the report is made of: paragraphs, pictures, tables."""

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from femfit.report.page import render


@dataclass(frozen=True)
class Picture:
    """A picture with what it shows.

    Parameters
    ----------
    alt : str
        What is seen, for readers who do not see it.
    narrow : bool
        Whether it takes less than the page's width.
    """

    name: str
    uri: str
    alt: str
    caption: Markup
    narrow: bool = False


@dataclass(frozen=True)
class DataTable:
    """A table.

    Parameters
    ----------
    rows : tuple of tuple of str or Markup
        Cells; the first of each row is its head.
    """

    caption: Markup
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


Block = Markup | Picture | DataTable


@dataclass(frozen=True)
class Section:
    """A section."""

    name: str
    title: str
    blocks: tuple[Block, ...]


def text(template: str, *values: object, **named: object) -> Markup:
    """A paragraph from a template of ours, with values escaped."""
    return Markup(template).format(*values, **named)  # noqa: S704 - the templates are literals of this room


@dataclass(frozen=True)
class Page:
    """A report before it is put into HTML."""

    title: str
    lead: str
    summary: Sequence[str]
    sections: Sequence[Section]


def render_page(page: Page) -> str:
    """A page as HTML text."""
    facts = {
        "title": page.title,
        "lead": page.lead,
        "summary": page.summary,
        "sections": {section.name: section for section in page.sections},
        "chapters": [(section.name, section.title, "bench/section.html.j2") for section in page.sections],
    }
    return render("bench.html.j2", facts, {})
