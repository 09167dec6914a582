"""A drawing's wrong numbers are found from readings of a device whose field was solved anew, not of a linear model."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from femfit.core.errors import ActuatorFileError, TableError, UsageError
from femfit.device.load import actuator_from_toml
from femfit.field.sweep import run_sweep
from femfit.identify.calibration import calibrate as calibration
from femfit.identify.calibration.calibrate import _moved, calibrate
from femfit.identify.calibration.fit import Redrawn, estimate
from femfit.identify.calibration.numbers import Choice, Drawing
from femfit.identify.calibration.result import CalibratedNumber, remarks, verdict
from femfit.identify.comparison.lack_of_fit import LackOfFit
from femfit.identify.decision.allowances import beyond_noise
from femfit.identify.decision.campaign import considered_effects, gather
from femfit.identify.decision.effect_space import EffectSpace
from femfit.identify.noise.components import simulated_noise
from femfit.identify.readings.bench import placed
from femfit.identify.refit.add_effects import whitening_beside
from femfit.tables.measurement_file import read_bench_table
from support.actuators import GEOMETRY
from support.small_drawing import SMALL

HEIGHT, IRON = "moving.regions.magnet.z_mm[1]", "materials.iron.relative_permeability"
TRUE_VALUES = TRUE_HEIGHT, TRUE_IRON = 4.07, 430.0
OFFSET = 0.004
DISTANCES = "{ start = 4, stop = 12, step = 1 }"
BASE = SMALL.replace('kind = "hall"', 'kind = "hall"\nsensitivity_V_per_T = 10')
DRAWN = BASE.replace("z_mm = [0, 4]", "z_mm = [0, 4] # by the caliper")
TRUE = BASE.replace("z_mm = [0, 4]", f"z_mm = [0, {TRUE_HEIGHT}]").replace("= 500", f"= {TRUE_IRON}")
NOISE = {"force_N": 5e-5, "flux_linkage_Wb": 1e-7, "hall_V": 2e-4}


def readings(rows, seed=1, runs=3, offset=OFFSET, channels=tuple(NOISE)):
    """What a bench reads of a swept field, its Hall element off by a constant."""
    rng, tables = np.random.default_rng(seed), []
    true = {**{name: rows[name] for name in channels if name in rows}, "hall_V": 2.5 + offset + 10.0 * rows["hall_T"]}
    for run in range(1, runs + 1):
        read = {name: true[name] + NOISE[name] * rng.standard_normal(len(rows)) for name in channels}
        tables.append(
            pd.DataFrame({"run": run, "distance_m": rows["distance_m"], "current_A": rows["current_A"], **read})
        )
    return pd.concat(tables)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """The drawing, and the sweep of the device that was built; sweeps of the drawing as drawn are shared."""
    directory = tmp_path_factory.mktemp("calibration")
    (directory / "small.toml").write_text(DRAWN)
    return directory


@pytest.fixture(scope="module")
def built(place):
    return run_sweep(actuator_from_toml(TRUE), place / "built", workers=1).rows


@pytest.fixture(scope="module")
def bench(place, built):
    readings(built).to_csv(place / "bench.csv", index=False)
    return place / "bench.csv"


@pytest.fixture(scope="module")
def found(place, bench):
    return calibrate(place / "small.toml", bench, place / "runs", numbers=[HEIGHT, IRON], workers=1)


def test_two_numbers_are_found_beside_an_effect_that_is_none(found):
    height, iron = found.numbers
    assert (height.key, height.unit, iron.key, iron.unit) == (HEIGHT, "mm", IRON, "")
    assert abs(height.value - TRUE_HEIGHT) < 3.0 * height.sd_as_drawn < 0.03  # nothing else is off
    assert abs(iron.value - TRUE_IRON) < 3.0 * iron.sd_as_drawn < 75.0
    assert all(one.sd > one.sd_as_drawn for one in found.numbers)
    (hall,) = found.beside  # nobody asked for it: what the calibrated drawing leaves was diagnosed
    low, high = hall.ci95["offset_V"]
    assert hall.effect.name == "hall_offset"
    assert low - 0.5 * (high - low) < OFFSET < high + 0.5 * (high - low)
    assert found.settled


def test_a_number_of_the_drawing_is_the_same_in_every_run(found, bench):
    """What begins at a run is a magnet that was weakened, and no length."""
    observations = placed(found.model.without_effects, read_bench_table(bench))
    space = EffectSpace(gather(observations, considered_effects(drawn=observations.nominal.drawn)))
    drawn = {effect.name for effect in observations.nominal.drawn}
    assert {HEIGHT, IRON} <= drawn & set(space.variants)
    assert "remanence" in space.run_by_run
    assert not drawn & set(space.run_by_run)


def test_the_error_on_runs_left_out_falls_to_the_noise(found):
    for one in found.unseen.channels:
        assert one.after_over_noise < 1.25
        assert one.rms_after < 1.25 * NOISE[one.channel]
    assert found.unseen.channels[0].rms_before > 5.0 * NOISE["force_N"]
    assert found.lack_of_fit.p_value > 0.01


def test_the_drawing_that_is_written_has_the_field_of_the_device(found, place, built):
    """Solved afresh from the written text, with other meshes and between the swept distances: no slope is in it."""
    text, true = (one.replace(DISTANCES, "[4.5, 6.2, 9.7]") for one in (found.drawing, TRUE))
    rows, wanted = (
        run_sweep(actuator_from_toml(one), place / name, workers=1).rows
        for one, name in ((text, "new"), (true, "true"))
    )
    drawn = run_sweep(actuator_from_toml(DRAWN.replace(DISTANCES, "[4.5, 6.2, 9.7]")), place / "old", workers=1).rows
    for name in ("force_N", "flux_linkage_Wb"):
        left, before = (np.sqrt(np.mean((one[name] - wanted[name]) ** 2)) for one in (rows, drawn))
        assert left < 0.5 * NOISE[name]
        assert left < 0.05 * before


def test_comments_of_the_drawing_stay(found):
    assert "# by the caliper" in found.drawing
    changed = [new for old, new in zip(DRAWN.splitlines(), found.drawing.splitlines(), strict=True) if old != new]
    assert len(changed) == 2


def test_the_calibrated_model_has_the_effect_and_the_other_none(found):
    assert [one.effect.name for one in found.model.effects] == ["hall_offset"]
    assert found.model_as_drawn.effects == ()


def test_the_result_says_value_error_tolerance_and_the_fall(found):
    text = str(found)
    assert f"{found.numbers[0].value:.3f} ± {found.numbers[0].sd:.3f} mm" in text
    assert "What is left is noise (p = " in text
    assert f"± {found.numbers[0].sd_as_drawn:.5f} mm" in text
    assert "These errors come mostly from the numbers that were not fitted" in text
    assert "Fitted beside, not in the drawing: hall_offset" in text
    assert "As drawn, and calibrated without each run in turn:" in text
    data = found.to_dict()
    assert [one["key"] for one in data["numbers"]] == [HEIGHT, IRON]
    np.testing.assert_allclose(np.diag(data["covariance"]), [one.sd**2 for one in found.numbers])


def test_a_step_that_draws_what_cannot_be_built_is_halved(place):
    drawing = Drawing(DRAWN, "small.toml", place)
    step = {"change": np.array([-4.5]), "information": np.array([[1e4]])}  # of 4 mm
    radius = Choice(drawing.wanted("moving.regions.magnet.r_mm[1]"))
    changed, values = _moved(drawing, SimpleNamespace(choice=radius, values=np.array([4.0]), **step), 1.0)
    assert values.tolist() == [1.75]
    assert "r_mm = [0, 1.75]" in changed.text


def test_a_step_that_makes_the_misfit_larger_is_taken_back_and_halved(monkeypatch):
    """Steps 2.5 times as long as they should be, as of a slope that is far too small: whole ones diverge."""
    redrawn = lambda drawing, _directory, _measured, _workers, sweeps: SimpleNamespace(drawing=drawing, sweeps=sweeps)  # noqa: E731

    def at(redrawn, choice, values):
        x = float(values[0])
        return SimpleNamespace(
            redrawn=redrawn,
            choice=choice,
            values=values,
            change=-2.5 * values,
            step=abs(10.0 * x),
            cost=lambda _: x * x,
        )

    monkeypatch.setattr(calibration, "RISE", 0.0)
    monkeypatch.setattr(calibration, "swept", redrawn)
    monkeypatch.setattr(calibration, "estimate", at)
    monkeypatch.setattr(calibration, "_moved", lambda _, now, part: ("drawing", now.change * (part - 0.4)))
    start = at(SimpleNamespace(drawing="drawing", sweeps=1), None, np.array([1.0]))
    now = calibration._Task(None, None, None, 1, str).settled(start)
    assert now.step <= 0.1
    assert now.cost(now) <= 1e-4


def test_noise_is_said_only_within_1_2_times_the_noise(found, bench):
    """Else what re-mounts or runs take is said, or that the model misses the readings."""
    whitening = whitening_beside(placed(found.model, read_bench_table(bench)))
    observations = whitening.observations
    quiet = replace(whitening.noise, mount_m=0.0, run=np.zeros(3))
    remounts, runs = replace(quiet, mount_m=5e-6, test_mount_m=6e-6), replace(quiet, run=2.0 * quiet.sigma)
    two = replace(remounts, test_mount_m=1.0)  # Student's quantile of one difference: more than the stroke

    def said(noise, times, p_value=0.5):
        rms = {name: times * sd for name, sd in noise.known.items()}
        return verdict(observations, noise, LackOfFit(1.0, 10, p_value), beyond_noise(observations, noise, rms), rms)

    assert "is not noise" in said(quiet, 1.1, p_value=1e-9)
    assert said(quiet, 1.19).startswith("What is left is noise (p")
    assert "but the model misses the force by" in said(quiet, 1.5)
    assert "noise and the 6.0 µm by which the distance may differ" in said(remounts, 1.21)
    assert "noise and any error of the distance that differs from" in said(two, 1.21)
    assert "differs from run to run" in said(runs, 1.5)


def test_turns_that_are_not_whole_are_said():
    (facts,) = Drawing(DRAWN, "small.toml", None).wanted("turns")
    one = CalibratedNumber.of(facts, 98.7, 0.7, 0.6)
    now = SimpleNamespace(choice=Choice((facts,)), covariance=np.array([[0.36]]))
    (remark,) = remarks(now, (one,), ())
    assert remark == (
        "coils.coil.turns is written as found, 98.7, though turns are whole: 99 is 0.50 standard deviations away, the "
        "others as found."
    )
    assert not list(remarks(now, (replace(one, value=99.0),), ()))


@pytest.mark.long
def test_the_diagnosis_names_the_number_where_none_is_asked_for(place, built):
    """A lower magnet alone; it is written, and only then is nothing missing."""
    lower = BASE.replace("z_mm = [0, 4]", "z_mm = [0, 3.94]")
    rows = run_sweep(actuator_from_toml(lower), place / "lower", workers=1).rows
    readings(rows, offset=0.0).to_csv(place / "lower.csv", index=False)
    result = calibrate(place / "small.toml", place / "lower.csv", place / "runs", workers=1)
    by_key = {one.key: one for one in result.numbers}
    assert abs(by_key[HEIGHT].value - 3.94) < 3.0 * by_key[HEIGHT].sd
    assert result.lack_of_fit.p_value > 0.01


def test_a_pair_that_readings_cannot_separate_is_said(place):
    """The force alone, without current: a stronger magnet material is one of another recoil permeability."""
    rows = run_sweep(actuator_from_toml(BASE), place / "clean", workers=1).rows
    readings(rows[rows["current_A"] == 0.0], channels=("force_N",)).to_csv(place / "still.csv", index=False)
    pair = ["materials.hard.remanence_T", "materials.hard.relative_permeability"]
    result = calibrate(place / "small.toml", place / "still.csv", place / "runs", numbers=pair, effects=(), workers=1)
    (combination,) = result.undetermined
    assert set(combination.change) == set(pair)
    assert 0.5 < combination.left <= 1.0
    assert "Not determined by these data: " in str(result)
    assert "go together (correlation " in str(result)


def test_errors_say_what_to_do_before_anything_is_solved(place, bench, tmp_path):
    with pytest.raises(UsageError, match=rf"'moving.magnet.height_mm' is no number .* Near it: .*{HEIGHT[:14]}"):
        calibrate(place / "small.toml", bench, tmp_path / "runs", numbers="moving.magnet.height_mm")
    with pytest.raises(UsageError, match="No number is given"):
        calibrate(place / "small.toml", bench, tmp_path / "runs", numbers=())
    with pytest.raises(ActuatorFileError, match=r"sweep\.parameters must be absent"):
        calibrate(GEOMETRY / "emaws-variants.toml", bench, tmp_path / "runs")
    with pytest.raises(TableError, match="No measurement is given"):
        calibrate(place / "small.toml", [], tmp_path / "runs", numbers=HEIGHT)
    assert not (tmp_path / "runs").exists()


LITTLE = 0.02
"""Part of their tolerances by which numbers that are not fitted are off: what they change is then linear."""


def test_standard_deviations_hold_what_was_not_fitted(found, place):
    """Monte Carlo over noise and over all suspects within their tolerances, about the calibrated drawing.

    The square of the error in units of its covariance is 2 in the mean, 2 +- 0.26 of 60. The covariance that is said is
    in the mean Schmidt's, from a fit that leaves the others as drawn, moved by a tolerance of each of them in turn.
    """
    drawing, model = Drawing(found.drawing, "small.toml", place), found.model.without_effects
    choice, rng = Choice(drawing.wanted([HEIGHT, IRON])), np.random.default_rng(7)
    suspects = [
        one if one in choice.numbers else replace(one, tolerance=LITTLE * one.tolerance) for one in drawing.suspects
    ]
    drawing.__dict__["suspects"] = tuple(suspects)
    whitening = whitening_beside(placed(model, read_bench_table(place / "bench.csv")))
    here, base = Redrawn(drawing, found.table, model, whitening), whitening.observations.base
    known = sorted(filter(here.shows, suspects), key=lambda one: one not in choice.numbers)
    columns = np.stack([one.tolerance * here.column(one) for one in known], axis=1)
    tolerance, values = ([getattr(one, name) for one in known[:2]] for name in ("deviation", "value"))

    def fitted(read):
        beside = replace(whitening, observations=whitening.observations.with_values(read))
        return estimate(replace(here, whitening=beside), choice, np.array(values))

    squares, said, made = [], [], []
    for _ in range(60):
        off = rng.standard_normal(len(known))
        off[:2] *= (
            0.1  # of these the readings are linear in little more; their tolerances hardly matter beside the data
        )
        one = fitted(base + columns @ off + simulated_noise(whitening, rng))
        error = one.change - tolerance * off[:2]
        squares.append([error @ np.linalg.solve(covariance, error) for covariance in (one.error, one.covariance)])
        said.append(np.diag(one.error))
        made.append(error**2)
    with_others, as_drawn = np.mean(squares, axis=0)
    assert 1.4 < with_others < 2.6
    assert as_drawn > 10.0
    clean = fitted(base)
    moved = [fitted(base + column).change - clean.change for column in columns[:, 2:].T]
    schmidt = np.diag(clean.covariance) + np.sum(np.square(moved), axis=0)
    np.testing.assert_allclose(np.mean(said, axis=0), schmidt, rtol=0.4)  # of 60 squares: 0.18
    np.testing.assert_allclose(np.mean(made, axis=0), schmidt, rtol=0.4)


@pytest.mark.long
def test_a_number_that_is_twenty_tolerances_off_is_found_in_more_than_one_step(place, built):
    """The data know it far better than its tolerance; that it is unusual is said."""
    text = BASE.replace("length_mm = 0.03", "length_mm = 0.003").replace("= 500", f"= {TRUE_IRON}")
    (place / "tight.toml").write_text(text)
    readings(built, offset=0.0).to_csv(place / "tight.csv", index=False)
    result = calibrate(
        place / "tight.toml", place / "tight.csv", place / "tight", numbers=HEIGHT, effects=[], workers=1
    )
    assert result.settled
    assert abs(result.numbers[0].value - TRUE_HEIGHT) < 4.0 * result.numbers[0].sd
    assert "tolerances from its drawn value, which is unusual" in str(result)


@pytest.mark.long
def test_calibrations_of_several_campaigns_scatter_as_they_say(place, built):
    """Nothing but these two numbers is off, so that their errors are those with all others as drawn."""
    z = []
    for seed in range(10, 15):
        readings(built, seed).to_csv(place / "again.csv", index=False)
        data, asked = place / "again.csv", {"numbers": [HEIGHT, IRON], "effects": ["hall_offset"]}
        result = calibrate(place / "small.toml", data, place / "runs", workers=1, **asked)
        assert result.settled
        z.append([(one.value - true) / one.sd_as_drawn for one, true in zip(result.numbers, TRUE_VALUES, strict=True)])
    squares = np.sum(np.square(z), axis=0)
    assert np.all((squares > 0.2) & (squares < 20.5))  # chi-square of 5: 0.1 % and 99.9 %
