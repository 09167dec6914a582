"""The noise that is guessed from neighbouring settings, where nothing tells it."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.identify.comparison.compare import compare
from femfit.identify.constants import GUESS_WIDER
from femfit.identify.noise.components import estimate_noise
from femfit.identify.noise.scatter import guessed_noise
from femfit.identify.readings.bench import bench_observations
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.magnetics import CoenergySpline
from femfit.model.validity import ValidityBox
from support.campaign import NOISE, campaign
from support.splines import REFERENCE_DISTANCE, fitted_spline


def rising(model, seed, **more):
    table = campaign(model, seed, **({"runs": 1, "mount_m": 0.0, "rho": 0.0} | more))
    return replace(table, rows=table.rows[table.rows["branch"] > 0].reset_index(drop=True))


def voice_coil(d, i):
    """A moving coil: its flux linkage changes with its place, its inductance is 4 mH."""
    return 0.06 * np.exp(-(((d - 0.02) / 0.04) ** 2)) * i + 0.002 * i**2


def lifting_magnet(d, i):
    """A reluctance that falls with the air gap, no magnet."""
    return 0.5 * (0.02 + 6e-4 / (d + 0.004)) * i**2


@pytest.fixture(scope="module")
def devices(levitation_model):
    def other(name, coenergy, low, high):
        return replace(
            levitation_model,
            name=name,
            magnetics=CoenergySpline(
                DistanceCoordinate(REFERENCE_DISTANCE), fitted_spline(coenergy, np.linspace(low, high, 8), 2)
            ),
            sensor=None,
            validity=ValidityBox(0.015, 0.045, low, high),
        )

    others = (other("voice coil", voice_coil, -1.5, 1.5), other("lifting magnet", lifting_magnet, 0.0, 2.0))
    return {one.name: one for one in (levitation_model, *others)}


@pytest.mark.parametrize("name", ["test-rig", "voice coil", "lifting magnet"])
def test_a_clean_sweep_is_not_accused(devices, name):
    noise = {channel: sigma for channel, sigma in NOISE.items() if channel != "hall_V" or devices[name].sensor}
    verdicts = [
        compare(devices[name], rising(devices[name], seed, rho=0.5, noise=noise, distances=8, currents=6)).verdict
        for seed in range(4)
    ]
    assert verdicts == 4 * ["agrees"]


def test_white_noise_is_guessed_and_widened(levitation_model):
    observations = bench_observations(levitation_model, rising(levitation_model, 3, distances=24, currents=16))
    for name, sigma in NOISE.items():
        guess, degrees = guessed_noise(observations, name)
        # The larger of two medians of 350 pseudo-residuals each is known to 10 %
        assert guess == pytest.approx(GUESS_WIDER * sigma, rel=0.25)
        assert 20 < degrees < len(observations.value)


def test_a_smooth_misfit_is_not_taken_for_noise(levitation_model):
    def bent(readings, rows):
        return readings | {"force_N": 1.3 * readings["force_N"] + 0.02 * rows["current_A"].to_numpy() ** 2}

    observations = bench_observations(
        levitation_model, rising(levitation_model, 4, distances=16, currents=12, change=bent)
    )
    assert np.abs(observations.residual[observations.of("force_N")]).max() > 50 * NOISE["force_N"]
    assert guessed_noise(observations, "force_N")[0] < 2.5 * NOISE["force_N"]


def test_noise_that_lasts_along_a_sweep_shows_across_it(levitation_model):
    table = rising(levitation_model, 5, distances=24, currents=16, rho=0.8)
    guess, _ = guessed_noise(bench_observations(levitation_model, table), "hall_V")
    assert guess > 0.9 * NOISE["hall_V"]


def test_a_declaration_or_repeats_leave_no_room_for_a_guess(levitation_model):
    table = rising(levitation_model, 6)
    assert set(estimate_noise(bench_observations(levitation_model, table)).source.values()) == {"guess"}
    declared = replace(table, declared_noise={"force_N": 4e-4})
    assert estimate_noise(bench_observations(levitation_model, declared)).source == {"force_N": "declared"}
    repeated = campaign(levitation_model, 6, runs=3)
    assert set(estimate_noise(bench_observations(levitation_model, repeated)).source.values()) == {"repeats"}


def test_a_comparison_calls_its_noise_a_guess(levitation_model):
    comparison = compare(levitation_model, rising(levitation_model, 8))
    assert comparison.verdict == "agrees"
    assert {one.noise_source for one in comparison.channels} == {"guess"}
    assert any(one.code == "guessed-noise" for one in comparison.findings)
