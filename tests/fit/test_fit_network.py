"""The law of plungers that saturate, on sweeps of three devices and against its own closed form."""

import json

import numpy as np
import pytest

from femfit.core.errors import ModelFileError
from femfit.fit.build import fit_model
from femfit.fit.ranking import rank_laws
from femfit.laws.catalogue import BUILT_IN
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


def test_it_is_better_than_every_law_of_columns():
    rows, fit = network_of("push")
    assert fit.left_out < rank_laws(BUILT_IN, rows).recommended.error


LAW = NetworkMagnetics(3e-3, 0.4e-3, (2.0, 0.26, -0.02, 0.03), (0.22, 0.016), 0.05, (-0.01, -0.01))
DISTANCE, CURRENT = (axis.ravel() for axis in np.meshgrid(np.linspace(0.2e-3, 8e-3, 9), np.linspace(0.1, 1.5, 8)))


def written_out(law, distance, current):
    """Force in N and flux linkage in Wb without a derivative, as a microcontroller would work them out."""
    near = distance + law.distance_shift_m
    x, slope = np.log(near * (1.0 / law.reference_distance_m)), 1.0 / near
    r0, r1, r2, r3 = law.log_reluctance
    r = np.exp(((r3 * x + r2) * x + r1) * x + r0)
    s = law.saturation_Wb[1] * x + law.saturation_Wb[0]
    size = np.sqrt(current * current)
    gap = r * s
    b = gap + size + law.knee_A
    y = 2.0 * size / (np.sqrt(b * b - 4.0 * gap * size) + b)
    left = 1.0 - y
    psi = y * s
    per_saturation = (np.log(left) + y / left) * (law.knee_A * law.saturation_Wb[1])
    per_reluctance = 0.5 * psi * psi * r * ((3.0 * r3 * x + 2.0 * r2) * x + r1)
    force = (per_reluctance - per_saturation - 0.5 * law.leakage_H[1] * size * size) * slope
    return force, lambda: np.sign(current) * psi + (law.leakage_H[0] + law.leakage_H[1] * x) * current


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_force_and_flux_linkage_are_those_of_the_closed_form(sign):
    force, linkage = written_out(LAW, DISTANCE, sign * CURRENT)
    # Products of a dozen roundings each.
    np.testing.assert_allclose(flat(LAW).force(DISTANCE, sign * CURRENT), force, rtol=1e-9)
    np.testing.assert_allclose(flat(LAW).flux_linkage(DISTANCE, sign * CURRENT), linkage(), rtol=1e-9)


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
