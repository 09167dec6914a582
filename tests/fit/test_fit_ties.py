"""Choices between fits that are equal up to rounding: the first in the order given, on every processor."""

from types import SimpleNamespace

import numpy as np
import pytest

from femfit.fit import coenergy_choice, law_fit, ranking
from femfit.fit import sensed_field as hall
from femfit.laws.catalogue import all_laws
from femfit.laws.dipoles import DIPOLE_LOOP
from femfit.model.coordinate import DistanceCoordinate

LITTLE_LESS = 1.0 - 1e-9
"""A solver's last step, and an order of summation, change as much."""


def test_the_first_of_equal_laws_is_ranked_first(monkeypatch):
    laws = list(all_laws().values())[:3]
    errors = dict(zip((law.name for law in laws), (1.0, LITTLE_LESS, 0.5), strict=True))

    def candidate(law, _rows, _folds):
        fit = SimpleNamespace(operations=7)
        return ranking.Candidate(fit, law, None, 0.01 * errors[law.name], 0.0, 0.0, 0.0, 2)

    monkeypatch.setattr(ranking, "_candidate", candidate)
    monkeypatch.setattr(ranking, "ranking_folds", lambda _: [])
    rows = SimpleNamespace(error_scale=(1.0, "N"), hanging_weight=1.0)
    ranked = ranking.rank_laws(laws, rows)
    assert [one.law.name for one in ranked.candidates] == [laws[2].name, laws[0].name, laws[1].name]


def test_the_first_of_equal_starts_gives_a_laws_shape(monkeypatch):
    costs = iter((1.0, LITTLE_LESS, LITTLE_LESS**2))

    def least_squares(_function, start, **_options):
        return SimpleNamespace(x=start, cost=next(costs), success=True)

    monkeypatch.setattr(law_fit, "least_squares", least_squares)
    found = law_fit.search_shape(DIPOLE_LOOP, lambda shape: np.array(list(shape.values())))
    assert found == pytest.approx({p.name: p.start for p in DIPOLE_LOOP.shape})


def test_the_first_of_equal_shifts_holds_the_hall_field(monkeypatch):
    errors = iter((1e-6, LITTLE_LESS * 1e-6, LITTLE_LESS**2 * 1e-6))
    monkeypatch.setattr(hall, "_held_out", lambda *_: next(errors))
    coordinates = [DistanceCoordinate(0.02, shift) for shift in (0.0, 0.1, 0.2)]
    monkeypatch.setattr(hall, "distance_coordinates", lambda _: coordinates)
    rows = SimpleNamespace(currents=np.array([0.0, 1.0]), distances=np.linspace(0.01, 0.02, 8), without_current=False)
    basis, _ = hall._choose(rows, np.zeros(1), 1.0)
    assert basis.coordinate is coordinates[0]


@pytest.mark.parametrize("errors", [
    [(1e-6, 1e-6), (LITTLE_LESS * 1e-6, 1e-6 * LITTLE_LESS)],  # good enough
    [(1.0, 10.0), (10.0 * LITTLE_LESS, 1.0)],  # each the worse in one quantity
])  # fmt: skip
def test_the_first_of_equal_bases_holds_the_coenergy(errors):
    bases = [SimpleNamespace(size=12, number=k) for k in range(len(errors))]
    system = SimpleNamespace(
        held_out_errors=lambda basis: np.array(errors[basis.number]),
        rows=SimpleNamespace(inductance=None),
    )
    assert coenergy_choice._best(bases, system)[0].number == 0
