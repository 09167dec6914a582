"""A record of several circuits says what one of a single circuit does: a coil cut in two is the same device."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.fit.sensed_field import SensedRows, fit_sensed
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.series.observations import series_observations
from support.closed_loop import closed_loop, recorded
from support.halves import NAMES, cut_in_two


@pytest.fixture(scope="module")
def whole(levitation_model):
    return replace(levitation_model, sample_time_s=1e-3, sensor=None)


@pytest.fixture(scope="module")
def halves(whole):
    return cut_in_two(whole)


@pytest.fixture(scope="module")
def record(levitation_model):
    samples = closed_loop(replace(levitation_model, sample_time_s=1e-3), runs=2, seconds=2.5, seed=7)
    return recorded(samples.drop(columns="hall_V"), distance_m=1e-5, runs=(1, 2))


def of_both(record, inner=1.0, noise_A=0.0):
    """The same record of the halves: the same current in each, and half of the voltage."""
    rows = record.rows.drop(columns=["current_A", "voltage_V"])
    current, volts = (record.rows[name].to_numpy() for name in ("current_A", "voltage_V"))
    noise = noise_A * np.random.default_rng(1).standard_normal((2, len(rows)))
    columns = {"current_inner_A": inner * current + noise[0], "current_outer_A": current + noise[1]}
    columns |= {f"voltage_{name}_V": 0.5 * volts for name in NAMES}
    return replace(record, rows=rows.assign(**columns), given=("run", "time_s", *columns, "distance_m"))


def test_the_balances_of_the_halves_are_those_of_the_whole(whole, halves, record):
    one, two = series_observations(whole, record), series_observations(halves, of_both(record))
    names = ["force_balance_N", *(f"voltage_balance_{name}_V" for name in NAMES)]
    assert two.channels == tuple(names)
    ratio = one.value / one.base  # of which the windows' weights by their noise fall out
    for name, of_whole in zip(names, ("force_balance_N", "voltage_balance_V", "voltage_balance_V"), strict=True):
        here = two.of(name)
        np.testing.assert_allclose(two.value[here] / two.base[here], ratio[one.of(of_whole)], rtol=1e-6)


@pytest.mark.parametrize(("name", "value"), [("mass_error", 0.1), ("distance_offset", 1e-4), ("position_delay", 1e-3)])
def test_an_effect_of_the_device_changes_the_halves_as_it_changes_the_whole(whole, halves, record, name, value):
    effect = effect_by_name(name)
    change = []
    for model, data in ((whole, record), (halves, of_both(record))):
        observations = series_observations(model, data)
        moved = observations.predict([AddedEffect(effect, {effect.parameters[0].name: value})]) - observations.base
        change.append([moved[observations.channel == c] for c in range(2)])
    for k, share in enumerate((1.0, 0.5)):
        scale = np.abs(change[0][k]).max()
        np.testing.assert_allclose(change[1][k], share * change[0][k], atol=0.01 * max(scale, 1e-12))


def test_a_wrong_ammeter_of_one_circuit_is_named_from_a_record(halves, record):
    found = diagnose(halves, of_both(record, inner=1.0 / 1.1, noise_A=1e-4), bootstrap=0)
    (named,) = found.missing
    assert named.name == "current_gain:inner"
    assert named.parameters["gain_error"] == pytest.approx(0.1, abs=0.005)


def test_a_hall_element_of_several_circuits_is_left_to_the_filters(levitation_model, halves, record):
    d, inner, outer = (one.ravel() for one in np.meshgrid(np.linspace(0.01, 0.04, 12), *[[-1.0, 0.0, 1.0]] * 2))
    field = fit_sensed(SensedRows(d, np.stack([inner, outer], axis=1), inner * np.exp(-50.0 * d)), "hall").field
    hall = replace(halves, sensor=replace(levitation_model.sensor, field=field))
    data = of_both(record)
    heard = replace(data, rows=data.rows.assign(hall_V=2.5), given=(*data.given, "hall_V"))
    found = series_observations(hall, heard)
    assert found.channels == series_observations(halves, data).channels
    assert [one.column for one in found.findings if one.code == "hall-not-compared"] == ["hall_V"]
