"""A remainder of a record: it runs in simulator, filters and exports, and is judged by the filter on runs left out."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import femfit as ff
from femfit.effects.effect import AddedEffect, EffectParameter
from femfit.identify.noise.whitening import Whitening, chains_of
from femfit.identify.readings.bench import placed
from femfit.identify.refit.add_effects import whitening_beside
from femfit.identify.remainder.learn import Beside, columns_at, learn
from femfit.identify.remainder.parts import BRAKE, COENERGY, NAME, parts_of
from femfit.model.bspline import TensorSpline, basis_matrix
from femfit.model.carried import Brake, Carried, Curve, FieldChange, FieldTerm, bounded_basis, carried_effect
from femfit.model.coordinate import DistanceCoordinate
from femfit.targets.estimator import RUNTIME
from support.closed_loop import closed_loop, recorded

SHARE = EffectParameter("share", bounds=(0.0, 2.0), plausible=(0.0, 1.0), description="How much of it is there.")
NOISE = {"distance_m": 3e-5, "current_A": 4e-3}
COGGING_N, PITCH_M = 3e-3, 4e-3


def there(carried):
    return AddedEffect(carried_effect("hidden", "Something.", [SHARE], carried), {"share": 1.0})


@pytest.fixture(scope="module")
def model(levitation_model):
    return replace(levitation_model, sample_time_s=1e-3)


@pytest.fixture(scope="module")
def cogging():
    """A force that comes and goes with the distance, as of teeth, whatever the current: 3 mN sin(2 pi d / 4 mm)."""
    knots, expand = bounded_basis(0.015, 0.045, cells=60, degree=4)
    d = np.linspace(0.015, 0.045, 400)
    wanted = COGGING_N * PITCH_M / (2.0 * np.pi) * np.cos(2.0 * np.pi * d / PITCH_M)
    rows = basis_matrix(d, knots, 4) @ expand
    spline = TensorSpline(knots, np.array([-9.0, 9.0]), 4, 0, (expand @ np.linalg.lstsq(rows, wanted)[0])[:, None])
    return there(Carried(FieldChange((FieldTerm("share", DistanceCoordinate(1.0, inverse=False), spline),))))


@pytest.fixture(scope="module")
def clean(model):
    return recorded(closed_loop(model, runs=2, seconds=2.0, seed=3), runs=(1, 2), **NOISE)


@pytest.fixture(scope="module")
def learnt(model, cogging):
    record = recorded(closed_loop(model, [cogging], runs=2, seconds=2.0, seed=5), runs=(1, 2), **NOISE)
    return ff.add_effects(model, record, NAME)


def test_a_force_that_comes_and_goes_is_learnt_from_a_record(learnt):
    assert learnt.parts[0] == COENERGY
    assert learnt.accepted
    fall = {one.channel: one for one in learnt.fall.channels}["force_balance_N"]
    assert fall.before_over_noise > 2.0
    assert fall.after_over_noise < 1.3


def test_the_filter_with_it_is_better_on_runs_left_out(learnt):
    assert learnt.filter.better
    assert learnt.filter.mean_square[1] < 0.5 * learnt.filter.mean_square[0]


def test_clean_records_teach_nothing(model, clean):
    result = ff.add_effects(model, clean, NAME)
    assert not result.accepted
    assert not result.parts or result.fall_unseen < 9.0


def test_a_brake_is_learnt_as_one_that_never_pushes(model, clean):
    knots, expand = bounded_basis(0.0, 0.1, cells=6, degree=4)
    speed = np.linspace(0.0, 0.1, 60)
    shape = np.linalg.lstsq(basis_matrix(speed, knots, 4) @ expand, 6e-3 * np.tanh(speed / 0.02) ** 3)[0]
    truth = there(Carried(brake=Brake(Curve("share", knots, 4, np.maximum(expand @ shape, 0.0)), 1e-3)))
    observations = placed(model, clean)
    change = observations.predict([truth]) - observations.base
    braked = observations.with_values(observations.value + change)
    noise = whitening_beside(observations).noise
    parts = [part for part in parts_of(braked) if part.kind in {BRAKE, "current_A"}]
    whitening = Beside(Whitening(braked, noise, chains_of(braked)), np.zeros((len(braked.value), 0)))
    found = learn(whitening, parts, columns_at(braked, parts))
    assert [part.kind for part in found.coefficients] == [BRAKE]
    curve = found.effects[0].effect.carried.brake.against
    assert curve.coefficients.min() >= 0.0
    left = braked.value - braked.predict(found.effects)
    here = braked.of("force_balance_N")
    assert np.std(left[here]) < 1.1 * np.std(observations.residual[here])
    assert np.std(change[here]) > 0.5 * np.std(observations.residual[here])


def test_the_loop_closes_and_the_export_runs_with_it(learnt, tmp_path):
    loop = ff.close_loop(learnt.model, runs=1, seconds=0.3, rng=1)
    assert "lost" not in str(loop).splitlines()[0]
    ff.export(learnt.model, tmp_path / "package")
    d, i = "np.array([0.024, 0.9])", "np.array([0.3, 2.0])"
    code = (
        f"import numpy as np; from {RUNTIME}.model.json_file import read_model; "
        f"m = read_model('model.json').magnetics; print(repr(m.force({d}, {i}).tolist()))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path / "package", capture_output=True, text=True, check=True
    )
    inside, far = np.array([0.024, 0.9]), np.array([0.3, 2.0])
    np.testing.assert_array_equal(eval(done.stdout), learnt.model.magnetics.force(inside, far))  # noqa: S307  our own
