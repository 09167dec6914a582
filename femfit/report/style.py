"""One look for pages and pictures: sizes, fonts, words, numbers, a palette that colour-blind readers can tell apart."""

import base64
import io
import math
import re
import tomllib
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from markupsafe import Markup, escape

from femfit.core.files import PICTURE, replacing, require_outputs
from femfit.core.text import amount, probability, rounded

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.figure

Axes: TypeAlias = "matplotlib.axes.Axes"
Figure: TypeAlias = "matplotlib.figure.Figure"
"""By their names: who draws nothing must not wait for matplotlib."""

Drawing = Callable[[], "Figure"]
"""What makes a figure; it is drawn within :func:`style`."""

INK = "#24292f"
MUTED = "#6e7781"
PAPER = "#ffffff"

BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"
"""Okabe and Ito's palette, https://jfly.uni-koeln.de/color/ (2008)."""

CATEGORIES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)

WIDTH = 7.8
"""Width of a picture that fills the page's column, in inches."""

SETTINGS: dict[str, Any] = {
    "font.size": 9.0,
    "font.family": "sans-serif",
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.limits": (-4, 5),
    "grid.color": "#d8dee4",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.5,
    "lines.markersize": 3.5,
    "text.color": INK,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "figure.facecolor": PAPER,
    "svg.fonttype": "path",  # readers have other fonts; the pictures keep their layout
    "path.simplify_threshold": 0.2,
}


DPI = 110
"""Resolution of what is rasterised inside a figure: fields, and curves of thousands of samples."""


@cache
def _words() -> dict[str, dict[str, str]]:
    return tomllib.loads((files("femfit.report") / "templates" / "figures.toml").read_text(encoding="utf-8"))


def words(figure: str, key: str, **values: object) -> str:
    """A label of a figure as ``templates/figures.toml`` has it, its ``{names}`` replaced by values."""
    return _words()[figure][key].format(**values)


def style(**more: Any) -> AbstractContextManager[None]:
    """A context with :data:`SETTINGS`, that leaves matplotlib's own settings as they were."""
    import matplotlib as mpl

    settings: Any = SETTINGS | {name.replace("__", "."): value for name, value in more.items()}
    return mpl.rc_context(settings)


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """An empty figure, without any state of pyplot."""
    return _styled_class()(figsize=(width, height), layout="constrained")


@cache
def _styled_class() -> "type[Figure]":
    """Figures that keep their look wherever they are drawn, and show themselves in a notebook."""
    import matplotlib.figure

    class StyledFigure(matplotlib.figure.Figure):
        def draw(self, renderer: Any) -> None:
            with style():
                super().draw(renderer)

        def _repr_png_(self) -> bytes:
            buffer = io.BytesIO()
            self.savefig(buffer, dpi=DPI)
            return buffer.getvalue()

    return StyledFigure


def label(axes: Axes, figure: str, x: str, y: str, title: str = "", **values: object) -> None:
    """Write a figure's words beside its axes."""
    axes.set(xlabel=words(figure, x), ylabel=words(figure, y, **values))
    if title:
        axes.set_title(words(figure, title))


def ordered_colours(count: int) -> list[tuple[float, float, float, float]]:
    """Colours for ordered values such as currents, dark to light, all readable on white."""
    import matplotlib as mpl

    viridis = mpl.colormaps["viridis"]
    return [viridis(0.85 * k / max(count - 1, 1)) for k in range(count)]


def svg_uri(draw: Drawing, name: str) -> str:
    """Draw a figure as the data URI of an SVG image; text becomes lines, and what is rasterised PNG inside."""
    buffer = io.BytesIO()
    with style(svg__hashsalt=name):
        draw().savefig(buffer, format="svg", dpi=DPI, metadata={"Date": None, "Creator": None})
    return data_uri("image/svg+xml", buffer.getvalue())


def write_picture(draw: Drawing, path: str | Path, dpi: float = DPI, **options: Any) -> None:
    """Draw a figure and write it as PNG, SVG or PDF, by the file's suffix."""
    path = Path(path)
    require_outputs([], (path, PICTURE))
    with style(), replacing(path) as unfinished:
        draw().savefig(unfinished, dpi=dpi, format=path.suffix.lstrip(".").lower() or "png", **options)


def data_uri(kind: str, content: bytes) -> str:
    """A file's content as data URI, so that a page needs nothing beside it."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


NO_BREAK = "\u00a0"

NOTHING = "–"
"""In place of a number that there is none of."""

_EXPONENT = re.compile(r"\^(?:\((-?[\d/]+)\)|(-?\d+))")

_POWER = re.compile(r"e([+-]?\d+)")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def quantity(value: float | None, unit: str, digits: int = 3) -> str:
    """An amount as it is set on a page."""
    number, _, unit = amount(value, unit.replace("Ω", "ohm"), digits).partition(" ")
    return f"{_set(number)}{NO_BREAK}{unit}".rstrip().replace("ohm", "Ω")


def percent(fraction: float | None, digits: int = 2) -> str:
    """A fraction in per cent."""
    return quantity(fraction, "", digits)


def significant(value: float, digits: int = 3) -> str:
    """A number with so many significant digits, in powers of ten where it is very large or small."""
    return _set(rounded(value, digits)) if math.isfinite(value) else NOTHING


def p_value(value: float) -> str:
    """A probability as it is set on a page."""
    return _set(probability(value))


def _set(number: str) -> str:
    return _POWER.sub(lambda m: f"·10{str(int(m[1])).translate(_RAISED)}", number).replace("-", "−")


def plain(value: float, digits: int = 6) -> str:
    """A number that was typed in, with no digit more than it had."""
    return f"{value:.{digits}g}".replace("-", "−") if math.isfinite(value) else NOTHING


def at_currents(current: float | Sequence[float], names: Sequence[str], digits: int = 4) -> str:
    """Currents as a text: ``2 A``, or ``lower 2 A and upper −1 A``."""
    if isinstance(current, int | float):
        return f"{plain(current, digits)} A"
    each = (f"{name} {plain(value, digits)} A" for name, value in zip(names, current, strict=True))
    return " and ".join(each)


def formula_markup(formula: str) -> Markup:
    """A formula for the page, from plain text with exponents as ``^-4`` or ``^(-3/2)``."""
    raised = _EXPONENT.sub(lambda m: f"<sup>{m[1] or m[2]}</sup>".replace("-", "−"), str(escape(formula)))
    return Markup(raised)  # noqa: S704 - escaped before
