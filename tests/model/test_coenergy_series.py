"""A co-energy that is asked for the same again and again."""

import numpy as np
import pytest

from femfit.model.coenergy_table import KEPT, RepeatedCoenergy
from femfit.model.with_effects import base_coenergy

POINTS = np.linspace(0.016, 0.04, 5), np.linspace(0.1, 1.2, 5)


@pytest.fixture
def asked():
    """The orders of what was worked out."""
    return []


@pytest.fixture
def repeated(levitation_model, asked):
    coenergy = base_coenergy(levitation_model)

    def counted(distance, current, in_distance, in_current):
        asked.append((in_distance, in_current))
        return coenergy(distance, current, in_distance, in_current)

    return RepeatedCoenergy(counted)


def test_what_was_asked_before_is_given_again_by_value(levitation_model, repeated, asked):
    d, i = POINTS
    exact = base_coenergy(levitation_model)(d, i, 2, 1).coefficients
    for _ in range(3):
        np.testing.assert_array_equal(repeated(d.copy(), i.copy(), 2, 1).coefficients, exact)
    assert asked == [(2, 1)]
    repeated(d, i, 1, 1)
    repeated(d, 0.9 * i, 2, 1)
    repeated(i, d, 2, 1)
    assert asked == [(2, 1), (1, 1), (2, 1), (2, 1)]


def test_what_is_given_cannot_be_changed_for_the_next_one_who_asks(repeated):
    with pytest.raises(ValueError, match="read-only"):
        repeated(*POINTS, 1, 1).coefficients[0, 0, 0] += 1.0


def test_what_was_asked_long_ago_is_forgotten(repeated, asked):
    d, i = POINTS
    for k in range(KEPT):
        repeated(d, i + k, 1, 1)
        repeated(d, i, 1, 1)  # asked again and again, it stays
    assert len(asked) == KEPT
    repeated(d, i + KEPT, 1, 1)
    repeated(d, i, 1, 1)
    assert len(asked) == KEPT + 1
    repeated(d, i + 1.0, 1, 1)
    assert len(asked) == KEPT + 2
