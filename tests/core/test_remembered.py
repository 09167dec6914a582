"""What is remembered of an object is worked out once, cannot be changed, and keeps nothing alive."""

import gc
from weakref import ref

import numpy as np
import pytest

from femfit.core.results import remembered


class Coil:
    """Something that a weak reference can point to."""


def test_it_is_worked_out_once_for_each_object():
    calls = []
    found = remembered(lambda coil: calls.append(coil) or len(calls))
    one, two = Coil(), Coil()
    assert [found(one), found(two), found(one)] == [1, 2, 1]


def test_its_arrays_cannot_be_written_to():
    found = remembered(lambda _: np.zeros(2))
    with pytest.raises(ValueError, match="read-only"):
        found(Coil())[0] = 1.0


def test_it_keeps_no_object_alive():
    found, coil = remembered(lambda _: np.zeros(2)), Coil()
    found(coil)
    seen = ref(coil)
    del coil
    gc.collect()
    assert seen() is None
