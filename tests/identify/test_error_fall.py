"""The fall of the error has one definition, and the first picture has its data."""

import numpy as np
import pytest

from femfit.effects.catalogue import effect_by_name
from femfit.effects.conditions import Conditions
from femfit.effects.effect import AddedEffect
from femfit.identify.comparison.misfit import error_fall, measured_curves
from femfit.identify.readings.bench import bench_observations
from femfit.model.readings import predict_readings
from femfit.model.with_effects import nominal_of
from support.campaign import NOISE, campaign

HALL = AddedEffect(effect_by_name("hall_offset"), {"offset_V": 0.02})


@pytest.fixture(scope="module")
def observations(levitation_model):
    return bench_observations(levitation_model, campaign(levitation_model, 21, [HALL]))


def test_the_fall_is_the_rms_of_all_readings_as_recorded(observations):
    fall = error_fall(observations, observations.base, observations.predict([HALL]), NOISE)
    rows = {one.channel: one for one in fall.channels}
    one = rows["hall_V"]
    here = observations.of("hall_V")
    assert one.readings == here.sum()
    assert one.rms_before == pytest.approx(np.sqrt(np.mean(observations.residual[here] ** 2)), rel=1e-12)
    assert one.before_over_noise == pytest.approx(0.02 / NOISE["hall_V"], rel=0.1)
    assert one.after_over_noise == pytest.approx(1.0, rel=0.15)
    assert rows["force_N"].rms_before == rows["force_N"].rms_after  # a Hall element's offset pulls at nothing
    assert "unchanged" in str(rows["force_N"])
    assert set(fall.to_dict()["hall_V"]) == {
        "readings",
        "rms_before",
        "rms_after",
        "noise",
        "before_over_noise",
        "after_over_noise",
    }


def test_measured_points_lie_on_the_curves_of_what_was_hidden(levitation_model, observations):
    curves = {one.channel: one for one in measured_curves(levitation_model, observations, after=[HALL])}
    hall, force = curves["hall_V"], curves["force_N"]
    assert (force.along, force.over) == ("distance_m", "current_A")
    assert force.before.shape == (len(force.levels), len(force.axis))
    np.testing.assert_array_equal(force.before, force.after)
    np.testing.assert_allclose(hall.after - hall.before, 0.02, rtol=1e-9)
    at = Conditions(nominal_of(levitation_model))
    read = predict_readings(levitation_model, force.axis, np.full(len(force.axis), force.levels[0]), at)
    np.testing.assert_allclose(force.before[0], read["force_N"], rtol=1e-9)
    assert np.mean(hall.misfit_before) == pytest.approx(0.02, abs=2e-3)
    assert abs(np.mean(hall.misfit_after)) < 2e-3
