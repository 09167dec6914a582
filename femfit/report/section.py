"""What a section of the report is made of: paragraphs, pictures, tables."""

from dataclasses import dataclass

from markupsafe import Markup


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
    header : tuple of str or Markup
        One a column; empty for none.
    rows : tuple of tuple of str or Markup
        Cells; the first of each row is its head.
    """

    caption: Markup
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


Block = Markup | Picture | DataTable


@dataclass(frozen=True)
class Section:
    """A section.

    Parameters
    ----------
    blocks : tuple of Markup, Picture or DataTable
        In order; a Markup is a paragraph.
    """

    name: str
    title: str
    blocks: tuple[Block, ...]


def text(template: str, *values: object, **named: object) -> Markup:
    """A paragraph from a template of ours, with values escaped."""
    return Markup(template).format(*values, **named)  # noqa: S704 - the templates are literals of this room
