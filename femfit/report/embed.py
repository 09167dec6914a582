"""Pictures as data URIs, so that the report is one file."""

import base64
import io
from typing import TYPE_CHECKING

from femfit.report.style import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 110
"""Of what is rasterised inside a figure: fields, and curves of thousands of samples."""


def svg_uri(figure: "Figure", name: str) -> str:
    """A figure as SVG; lines and text stay lines, rasterised artists become PNG inside.

    Parameters
    ----------
    name : str
        Seeds the identifiers inside, so that the same figure gives the same bytes.
    """
    buffer = io.BytesIO()
    with style(svg__hashsalt=name):
        figure.savefig(buffer, format="svg", dpi=DPI, metadata={"Date": None, "Creator": None})
    return _uri("image/svg+xml", buffer.getvalue())


def png_uri(image: bytes) -> str:
    """A PNG file's content as data URI."""
    return _uri("image/png", image)


def _uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
