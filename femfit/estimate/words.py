"""The words of filters and of records."""

from femfit.core.results import Words, constants_of
from femfit.estimate import constants

sentence = Words("femfit.estimate", names=constants_of(constants)).sentence
