"""The law of plungers that saturate, on sweeps of three devices and against its own closed form."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from femfit.core.errors import ModelFileError
from femfit.fit import coenergy_choice, ranking
from femfit.fit.build import fit_model
from femfit.fit.ranking import rank_laws
from femfit.laws.catalogue import BUILT_IN, all_laws
from femfit.model.json_file import model_from_dict, model_to_dict
from femfit.model.several_magnetics import NetworkMagnetics
from support.one_current import flat
from support.plungers import DEVICES, network_of, plunger_table


@pytest.fixture(params=DEVICES)
def fitted(request):
    return network_of(request.param)


def test_force_of_a_saturating_plunger_is_met_within_two_percent(fitted):
    rows, fit = fitted
    assert fit.fitted < 0.02
    table = rows.linked[:, 0]
    flux = flat(fit.magnetics).flux_linkage(rows.distance, rows.current) - table
    assert np.sqrt(np.mean(flux**2)) < 0.02 * np.sqrt(np.mean(table**2))


@pytest.mark.nightly
def test_it_is_better_than_every_law_of_columns():
    rows, fit = network_of("push")
    assert fit.left_out < rank_laws(BUILT_IN, rows).recommended.error


def test_the_model_keeps_the_law_and_says_its_misfit():
    fit = fit_model(plunger_table("pull"), law="reluctance-network")
    assert fit.misfit.force_share < 0.02
    assert "reluctance-network" in str(fit)
    again = model_from_dict(json.loads(json.dumps(model_to_dict(fit.model))))
    assert again.magnetics.log_reluctance == fit.model.magnetics.log_reluctance
    assert again.force(1e-3, 0.7) == fit.model.force(1e-3, 0.7)
    fit.model.require_dynamics()
    data = model_to_dict(fit.model)
    data["magnetics"]["leakage_H"] = [1.0]
    with pytest.raises(ModelFileError, match=r"magnetics\.leakage_H must be 2 numbers"):
        model_from_dict(data)


def test_all_takes_the_network_where_no_law_of_columns_is_good():
    fit = fit_model(plunger_table("pull"), law="all")
    assert fit.law is None
    assert isinstance(fit.model.magnetics, NetworkMagnetics)
    assert fit.to_dict()["model"] == "reluctance-network"


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
