"""Impedances at other currents than those about which the eddy currents of iron that saturates were solved."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.identify.decision.diagnose import diagnose
from femfit.identify.readings.bench import bench_observations, placed
from femfit.identify.readings.impedance import away_from_bias
from femfit.model.eddy_currents import EddyBias
from support.conductivities import KEY, with_conductivity, with_drawn_conductivity
from support.impedances import impedance_table

SHARE = -0.12  # As much as another permeability may look like a conductivity


def solved_about(model, current, materials=("core",)):
    """The model with eddy currents that were solved about a current of each circuit."""
    drawn = with_drawn_conductivity(model)
    box = model.validity
    distances = np.array([box.distance_min_m, box.distance_max_m])
    return replace(drawn, eddy=replace(drawn.eddy, bias=EddyBias(distances, np.full((2, 1), current), materials)))


def at_half_an_ampere(model, path, share=SHARE):
    """Impedances of eddy currents as of another conductivity, at one bias of 0.5 A over 2 mm."""
    box = replace(model.validity, distance_min_m=0.016, distance_max_m=0.018, current_min_A=0.5, current_max_A=0.5)
    return impedance_table(replace(with_conductivity(model, share), validity=box), path, biases=1)


def test_what_another_permeability_makes_is_no_wrong_conductivity(levitation_model, tmp_path):
    table = at_half_an_ampere(levitation_model, tmp_path / "z.csv")
    found = diagnose(solved_about(levitation_model, 1.2), table, bootstrap=0)
    assert not found.missing
    assert abs(found.detectable.get(KEY, {"change": 1.0})["change"]) > 2.0 * abs(SHARE)
    assert "Nothing is missing beyond what the model may miss by itself" in str(found)
    assert "were read at 0.50 A; the model's eddy currents hold about 1.2 A" in str(found)
    assert "measure at 1.2 A, or sweep with eddy_bias_A = 0.5 under [solver]" in str(found)
    assert "The lag is" not in str(found)


@pytest.mark.parametrize("bias", [0.5, None])
def test_at_the_bias_a_wrong_conductivity_keeps_its_name(levitation_model, tmp_path, bias):
    model = with_drawn_conductivity(levitation_model) if bias is None else solved_about(levitation_model, bias)
    found = diagnose(model, at_half_an_ampere(levitation_model, tmp_path / "z.csv"), bootstrap=0)
    assert [one.name for one in found.missing] == [KEY]
    assert found.missing[0].parameters["change"] == pytest.approx(SHARE, abs=0.01)
    assert not found.observations.away_from_bias
    assert "The lag is" not in str(found)  # one of several conductivities is wrong, and the lag with it


def test_the_form_of_another_permeability_is_granted_by_the_flux_between(levitation_model, tmp_path):
    model = solved_about(levitation_model, 1.2)
    table = at_half_an_ampere(levitation_model, tmp_path / "z.csv", share=0.0)
    seen = placed(model, table)
    flux = [levitation_model.magnetics.flux_linkage(seen.covariates["distance_m"].to_numpy(), i) for i in (0.5, 1.2)]
    box = levitation_model.validity
    largest = max(
        np.abs(levitation_model.magnetics.flux_linkage(seen.covariates["distance_m"].to_numpy(), end)).max()
        for end in (box.current_min_A, box.current_max_A)
    )
    off = (np.abs(flux[1] - flux[0]) / (2.0 / 3.0 * largest))[seen.row]
    other = placed(with_conductivity(levitation_model, 1e-4), table)
    slope = (other.base / other.weight - seen.base / seen.weight) / 1e-4
    assert seen.bias_columns.shape == (len(seen.row), 1)
    for name in seen.channels:
        here = seen.of(name)
        found, expected = seen.bias_columns[here, 0] / seen.weight[here], off[here] * slope[here]
        assert found == pytest.approx(expected, abs=1e-2 * np.abs(expected).max())


def test_the_distance_from_the_bias_is_that_of_the_flux_and_the_inductance(levitation_model):
    model = solved_about(levitation_model, 0.7)
    d = np.full(3, 0.02)
    away = away_from_bias(model, d, np.array([0.7, 0.9, 1.4]))
    assert away.flux[0] == pytest.approx(0.0, abs=1e-12)
    assert away.inductance[0] == pytest.approx(0.0, abs=1e-12)
    inductance = levitation_model.magnetics.inductance(d, np.array([0.7, 0.9, 1.4]))
    expected = np.abs(inductance - inductance[0]) / np.maximum(inductance, inductance[0])
    assert away.inductance == pytest.approx(expected)
    assert 0.0 < away.flux[1] < away.flux[2]
    assert away_from_bias(model, d, np.full(3, 0.4)).flux[0] < 0.0
    linear = away_from_bias(with_drawn_conductivity(levitation_model), d, np.array([0.0, 0.7, 1.4]))
    assert not linear.flux.any()
    assert not linear.inductance.any()


def test_iron_that_does_not_conduct_grants_what_the_inductance_differs_alone(levitation_model, tmp_path):
    table = at_half_an_ampere(levitation_model, tmp_path / "z.csv", share=0.0)
    model = solved_about(levitation_model, 1.2, materials=())
    seen, linear = (bench_observations(one, table) for one in (model, with_drawn_conductivity(levitation_model)))
    assert seen.bias_columns.shape == (len(seen.row), 0)
    assert np.all(seen.tolerance >= linear.tolerance)
    assert seen.own_misfit == pytest.approx(seen.tolerance)
