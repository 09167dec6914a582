"""The words of fits: what is printed of one, and notes on what a model lacks or misses; they stand in ``templates``."""

from functools import partial
from textwrap import shorten
from typing import Any

from femfit.core.results import Words, listing
from femfit.core.text import amount, rounded
from femfit.fit.constants import COARSE, SMALL_CIRCUIT_FORCE, TARGET
from femfit.model.actuator_model import sentence
from femfit.model.several_magnetics import NETWORK, OPERATIONS

_WORDS = Words(
    "femfit.fit",
    listing,
    shorten,
    share=lambda value: amount(value, ""),
    percent=lambda share: "-" if share is None else rounded(100.0 * share, 2),
    names={
        "of_model": partial(sentence, "model"),
        "network_name": NETWORK,
        "network_operations": OPERATIONS,
        "small": SMALL_CIRCUIT_FORCE,
        "target": TARGET,
        "coarse": COARSE["force"],
    },
)


def printed(template: str, **facts: Any) -> str:
    """Fill a template of the room with results and numbers."""
    return _WORDS.environment.get_template(template).render(facts).rstrip()


note = partial(_WORDS.sentence, "notes")
"""What a macro of ``notes.j2`` makes of facts."""
