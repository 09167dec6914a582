"""The words of results: each result has one template in ``templates``, which is filled with its numbers and codes.

In a template a paragraph is one printed line, however it is broken; ``>`` before it stands for two blanks each.
"""

from typing import Any

from femfit.core.results import Words, constants_of, lines_of
from femfit.core.text import amount_in, probability, rounded, weighed_amount
from femfit.effects.words import describe, range_of, size_of
from femfit.identify import constants
from femfit.tables.measurement import channel_words


def _listed(items: Any, word: str = "and", most: int | None = None) -> str:
    """Items as ``a, b and c``; of more than ``most`` the first ones, and how many more there are."""
    texts = [str(item) for item in items]
    texts = [*texts[:most], f"{len(texts) - most} more"] if most and len(texts) > most else texts
    return f" {word} ".join([", ".join(texts[:-1]), texts[-1]] if len(texts) > 1 else texts)


_WORDS = Words(
    "femfit.identify",
    amount_in,
    describe,
    probability,
    range_of,
    rounded,
    size_of,
    weighed_amount,
    listed=_listed,
    signed="{:+.3g}".format,
    channel=channel_words,
    names=constants_of(constants),
)


def sentence(template: str, macro: str, *facts: Any) -> str:
    """The text that a macro of a template makes of facts, in one line; empty where it has nothing to say."""
    return " ".join(_WORDS.lines(template, macro, *facts))


finding = _WORDS.finding


def printed(template: str, **facts: Any) -> str:
    """The lines that a template makes of facts."""
    return "\n".join(lines_of(_WORDS.environment.get_template(f"{template}.j2").render(facts)))
