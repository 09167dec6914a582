"""Choices between fits that are equal up to rounding: the first in the order given, on every processor."""

from types import SimpleNamespace

import numpy as np
import pytest

from femfit.fit import coenergy_choice, ranking
from femfit.laws.catalogue import all_laws

LITTLE_LESS = 1.0 - 1e-9
"""A solver's last step, and an order of summation, change as much."""


def test_the_first_of_equal_laws_is_ranked_first(monkeypatch):
    laws = list(all_laws().values())[:3]
    errors = dict(zip((law.name for law in laws), (1.0, LITTLE_LESS, 0.5), strict=True))

    def candidate(law, _rows, _folds):
        fit = SimpleNamespace(operations=7)
        return ranking.Candidate(law, fit, None, 0.01 * errors[law.name], 0.0, 2)

    monkeypatch.setattr(ranking, "_candidate", candidate)
    monkeypatch.setattr(ranking, "ranking_folds", lambda _: [])
    rows = SimpleNamespace(error_scale=(1.0, "N"), hanging_weight=1.0)
    ranked = ranking.rank_laws(laws, rows)
    assert [one.law.name for one in ranked.candidates] == [laws[2].name, laws[0].name, laws[1].name]


@pytest.mark.parametrize("errors", [
    [(1e-6, 1e-6), (LITTLE_LESS * 1e-6, 1e-6 * LITTLE_LESS)],  # good enough
    [(1.0, 10.0), (10.0 * LITTLE_LESS, 1.0)],  # each the worse in one quantity
])  # fmt: skip
def test_the_first_of_equal_bases_holds_the_coenergy(errors):
    chosen, _ = coenergy_choice.smallest([range(len(errors))], lambda number: np.array(errors[number]))
    assert chosen == 0
