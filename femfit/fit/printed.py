"""The words that a fit's results print stand in ``templates/``; here are the filters of their numbers."""

from collections import Counter
from collections.abc import Sequence
from functools import cache, partial
from textwrap import shorten
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from femfit.core.text import amount, counted, rounded
from femfit.fit.constants import SMALL_CIRCUIT_FORCE, TARGET
from femfit.model.model_text import sentence
from femfit.model.network_magnetics import NETWORK, OPERATIONS

_LABELS_SHOWN = 4
"""So many active constraints are listed; more are counted."""


def printed(template: str, **facts: Any) -> str:
    """Fill a template of the room with results and numbers."""
    return _environment().get_template(template).render(facts).rstrip()


@cache
def _environment() -> Environment:
    environment = Environment(  # noqa: S701  text for a terminal
        loader=PackageLoader("femfit.fit"), trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined
    )
    environment.filters |= {
        "amount": amount,
        "share": lambda value: amount(value, ""),
        "percent": lambda share: "-" if share is None else rounded(100.0 * share, 2),
        "places": _places,
        "shorten": shorten,
    }
    environment.globals |= {
        "of_model": partial(sentence, "model"),
        "network_name": NETWORK,
        "network_operations": OPERATIONS,
        "small": SMALL_CIRCUIT_FORCE,
        "target": TARGET,
    }
    return environment


def _places(labels: Sequence[str]) -> str:
    """A few labels as they are; of many, how often each stands before its place."""
    if len(labels) <= _LABELS_SHOWN:
        return "; ".join(labels) or "none"
    counts = Counter(label.partition(" at ")[0] for label in labels)
    return "; ".join(f"{name} at {counted(count, 'place')}" for name, count in counts.items())
