"""A page from a template: the words stand in ``templates/``, the numbers come from the rooms below."""

import math
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from femfit import __version__
from femfit.core.amount import counted
from femfit.core.atomic import write_text
from femfit.core.errors import RunDirectoryError
from femfit.report.circuits import at_currents
from femfit.report.numbers import NOTHING, formula_markup, p_value, percent, plain, quantity, significant
from femfit.report.style import words
from femfit.tables.measurement import CHANNEL_WORDS

if TYPE_CHECKING:
    from jinja2 import Environment

LARGEST_BYTES = 3_000_000
"""A report is one file that can be sent by mail."""


def render(template: str, facts: Mapping[str, Any], figures: Mapping[str, str]) -> str:
    """Fill a template with numbers and with the data URIs of pictures by name."""
    return _environment().get_template(template).render(facts, figures=figures)


@cache
def _environment() -> "Environment":
    """The templates, with the numbers' filters."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("femfit.report"),
        autoescape=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters |= {
        "quantity": quantity,
        "dash": lambda value, unit: quantity(value, unit) if math.isfinite(value) else NOTHING,
        "part": lambda name: words("loop", name),
        "percent": percent,
        "plain": plain,
        "significant": significant,
        "mm": lambda metres, digits=4: plain(1e3 * metres, digits),
        "words": lambda name: str(name).replace("_", " "),
        "at_currents": at_currents,
        "amperes": lambda current: f"{plain(current)} A",
        "wordy": lambda cells: (str(cells[0]).replace("_", " "), *cells[1:]),
        "formula": formula_markup,
        "channel": CHANNEL_WORDS.__getitem__,
        "p_value": p_value,
        "counted": counted,
    }
    templates = files("femfit.report") / "templates"
    environment.globals |= {
        "version": __version__,
        "style": (templates / "report.css").read_text(encoding="utf-8"),
        "script": (templates / "report.js").read_text(encoding="utf-8"),
        "unfinished": "",
    }
    return environment


def write_page(text: str, path: str | Path) -> Path:
    """Write a page, completely or not at all; its directory is made if absent."""
    encoded = text.encode()
    if len(encoded) > LARGEST_BYTES:
        raise RunDirectoryError(
            f"The report must stay below {LARGEST_BYTES / 1e6:g} MB; it has {len(encoded) / 1e6:.2f} MB. Sweep fewer "
            f"points."
        )
    write_text(path, text)
    return Path(path)
