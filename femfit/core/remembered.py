"""What follows from an object, worked out once and forgotten with the object."""

from collections.abc import Callable
from functools import wraps
from typing import TypeVar
from weakref import WeakKeyDictionary

import numpy as np

Given = TypeVar("Given")
Found = TypeVar("Found")


def remembered(function: Callable[[Given], Found]) -> Callable[[Given], Found]:
    """A function of one immutable object that is called once for each; an array that it returns cannot be written to.

    >>> class Coil: pass
    >>> ohms = remembered(lambda coil: np.ones(2))
    >>> coil = Coil()
    >>> ohms(coil) is ohms(coil)
    True
    """
    known: WeakKeyDictionary[Given, Found] = WeakKeyDictionary()

    @wraps(function)
    def once(given: Given) -> Found:
        if given not in known:
            found = function(given)
            if isinstance(found, np.ndarray):
                found.flags.writeable = False
            known[given] = found
        return known[given]

    return once
