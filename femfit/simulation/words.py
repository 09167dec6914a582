"""The words of simulations."""

from math import degrees, isfinite

from femfit.core.results import Words, constants_of
from femfit.core.text import quoted
from femfit.model.sensors import HALL
from femfit.simulation import constants


def sensor_word(name: str) -> str:
    """A sensor as it is written."""
    return "Hall" if name == HALL else name


_words = Words("femfit.simulation", degrees, isfinite, quoted, sensor_word, names=constants_of(constants))
sentence, finding = _words.sentence, _words.finding
