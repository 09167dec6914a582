"""Habits of a bench: what its file leaves out, and that nothing else changes."""

import json

import numpy as np
import pandas as pd
import pytest

from femfit.tables.measurement_file import read_bench_table
from femfit.trial.campaigns import TruthSet, make_campaigns
from femfit.trial.habits import Habits, drawn_habits, written
from femfit.trial.hidden import HIDDEN_ERRORS
from femfit.trial.truths.sets import truths_of
from femfit.trial.virtual_bench import make_campaign
from support.closed_form_device import DRAWING, closed_form_device


@pytest.mark.parametrize("order", ["kept", "not written", "shuffled", "shuffled, not written"])
def test_shuffled_rows_are_the_same_rows(order):
    rows = pd.DataFrame({"order": np.arange(50), "force_N": np.linspace(0.0, 1.0, 50)})
    shown = written(rows, Habits(order=order), np.random.default_rng(1))
    assert ("order" in shown) is not order.endswith("not written")
    assert shown["force_N"].is_monotonic_increasing is not order.startswith("shuffled")
    assert sorted(shown["force_N"]) == sorted(rows["force_N"])


@pytest.mark.parametrize(("extent", "least", "most"), [("three runs", 3, 3), ("few readings", 1, 3)])
def test_an_extent_holds_its_runs(extent, least, most):
    device = closed_form_device()
    for seed in range(5):
        campaign = make_campaign(device, {}, 0.0, np.random.default_rng(seed), Habits(extent))
        assert least <= campaign.runs <= most
        assert len(campaign.rows) <= (80 if extent == "few readings" else 10_000)


def test_one_channel_is_one_that_shows_the_error():
    errors = {"hall_offset": HIDDEN_ERRORS["hall_offset"]}
    campaign = make_campaign(closed_form_device(), errors, 1.0, np.random.default_rng(2), Habits("one channel"))
    assert list(campaign.meters) == ["hall_V"]


def test_habits_come_in_their_shares():
    rng = np.random.default_rng(3)
    habits = [drawn_habits(rng) for _ in range(4000)]
    assert np.mean([one.noise_declared for one in habits]) == pytest.approx(0.5, abs=0.03)  # four standard errors
    assert np.mean([one.extent == "few readings" for one in habits]) == pytest.approx(0.1, abs=0.02)
    assert np.mean([one.order == "kept" for one in habits]) == pytest.approx(0.6, abs=0.03)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Twenty campaigns of a set, with the truths that the device in closed form can show."""
    directory, device = tmp_path_factory.mktemp("set"), closed_form_device()
    truths = {
        name: truth
        for name, truth in truths_of(DRAWING, "calibration").items()
        if not truth.lacks(device.actuator) and "lateral" not in name
    }
    numbers = make_campaigns(device, directory, 20, 5, TruthSet("calibration", truths))
    places = [directory / "campaigns" / f"{number:04d}" for number in numbers]
    return [(place, json.loads((place / "hidden.json").read_text())) for place in places]


def test_twenty_campaigns_of_a_set_hide_all_kinds(made):
    groups = [tuple(key["group"].values()) for _, key in made]
    assert len(made) >= 17  # what cannot be as large as it should is left out
    assert {kind for group in groups for kind in group} == {"catalogue", "drawing", "when", "unseen"}
    assert groups.count(()) == 5
    assert {key["set"] for _, key in made} == {"calibration"}


def test_every_error_has_its_size_and_says_how_plain_it_is(made):
    for _, key in made:
        for name in key["hidden"]:
            assert max(key["over_noise"][name].values()) == pytest.approx(key["level"], rel=0.01)
            assert key["shown"][name] > 0.0
            assert name.endswith("(calibration)")
    assert any(key["when"] for _, key in made)


def test_declared_noise_is_read_and_the_data_say_nothing_else(made):
    for place, key in made:
        table = read_bench_table(place / "data.csv")
        declared = {name: meter["sigma"] for name, meter in key["meters"].items()}
        assert dict(table.declared_noise) == pytest.approx(
            declared if key["habits"]["noise_declared"] else {}, rel=1e-3
        )


def test_the_key_says_how_the_readings_scatter():
    # At the truth the weighted sum of squares is chi-square of as many degrees as there are readings
    device, weighted, count = closed_form_device(), 0.0, 0
    for seed in range(6):
        campaign = make_campaign(device, {}, 0.0, np.random.default_rng(seed))
        rows = campaign.rows
        d, i, run, order = (rows[name].to_numpy() for name in ("distance_m", "current_A", "run", "order"))
        ahead, fields, back = (device.drawn.at(d + shift, i) for shift in (1e-5, 0.0, -1e-5))
        slope = (ahead - back).times(1.0 / 2e-5)
        for name, volts in (("force", 1.0), ("flux_linkage", 1.0), ("hall", 50.0)):
            channel = {"force": "force_N", "flux_linkage": "flux_linkage_Wb", "hall": "hall_V"}[name]
            if channel not in campaign.meters:
                continue
            meter = campaign.meters[channel]
            residual = rows[channel].to_numpy() - volts * getattr(fields, name) - (2.5 if channel == "hall_V" else 0.0)
            for number in np.unique(run):
                at = np.flatnonzero((run == number) & np.isfinite(residual))
                covariance = meter.sigma**2 * meter.rho ** np.abs(np.subtract.outer(order[at], order[at]))
                moved = volts * getattr(slope, name)[at]
                covariance += meter.step**2 / 12.0 * np.eye(len(at)) + campaign.mount_m**2 * np.outer(moved, moved)
                weighted += residual[at] @ np.linalg.solve(covariance, residual[at])
                count += len(at)
    assert weighted / count == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / count))
