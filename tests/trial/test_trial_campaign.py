"""Campaigns: reproducible, as noisy as they say, with effects of the size that was asked for, and sealed keys."""

import json
from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import RunDirectoryError
from femfit.tables.measurement_file import read_bench_table
from support.trial_study.campaign.case import Order, make_case
from support.trial_study.campaign.files import read_key, write_case
from support.trial_study.campaign.orders import SHARES, draw_orders
from support.trial_study.campaign.plan import drawn_options, make_plan

ORDER = Order(7, "emaws-rig", ("hall_drift", "force_gain"), 3.0, 11)


def test_a_case_is_the_same_for_the_same_order(rig_truth):
    first, again, other = (make_case(rig_truth, order) for order in (ORDER, ORDER, replace(ORDER, seed=12)))
    assert first.rows.equals(again.rows)
    assert first.key == again.key
    assert not first.rows.equals(other.rows)


def test_each_effect_has_the_size_that_was_asked_for(rig_truth):
    for effect in make_case(rig_truth, ORDER).key["effects"]:
        assert max(effect["over_noise"].values()) == pytest.approx(3.0, rel=1e-2)


@pytest.mark.parametrize("number", range(6))
def test_campaigns_have_repeats_and_some_hundreds_of_rows(rig_truth, number):
    case = make_case(rig_truth, Order(number, "emaws-rig", (), 0.0, 5))
    assert 200 < len(case.rows) < 3200
    assert 2 <= case.rows["run"].nunique() <= 5
    assert set(case.unseen["run"]) == {case.rows["run"].max() + 1}
    assert case.rows["distance_m"].min() > 0.015


def test_mounts_scatter_by_what_the_plan_says(rig_truth):
    generator = np.random.default_rng(2)
    options = replace(drawn_options(rig_truth, generator), runs=5, mounts_per_run=3, mount_m=40e-6)
    errors = np.concatenate([np.unique(make_plan(rig_truth, options, generator).remount) for _ in range(40)])
    assert errors.std() == pytest.approx(40e-6, rel=0.1)  # 600 mounts: 3 %


def test_orders_hold_their_shares_and_go_round_the_effects():
    orders = draw_orders({"a": ["x", "y", "z"], "b": ["x", "w"]}, 100, 1)
    counts = {k: sum(len(order.effects) == k for order in orders) for k in SHARES}
    assert counts == {k: round(100 * share) for k, share in SHARES.items()}
    single = [order.effects[0] for order in orders if len(order.effects) == 1]
    assert max(map(single.count, "wxyz")) - min(map(single.count, "wxyz")) <= 1


def test_keys_are_sealed_and_the_files_are_what_the_reader_reads(rig_truth, tmp_path):
    (tmp_path / "model.json").write_text("{}")
    case = make_case(rig_truth, ORDER)
    commitment = write_case(case, tmp_path / "model.json", tmp_path)
    table = read_bench_table(tmp_path / "cases" / "0007" / "data.csv")
    assert len(table.rows) == len(case.rows)
    np.testing.assert_allclose(table.rows["force_N"], case.rows["force_N"], rtol=1e-8)
    assert dict(table.declared_noise) == pytest.approx(dict(case.declared_noise))
    shown = {file.name for file in (tmp_path / "cases" / "0007").iterdir()} - {"data.toml"}
    assert shown == {"model.json", "data.csv", "unseen.csv"}
    key = read_key(tmp_path, 7, commitment)
    assert [effect["name"] for effect in key["effects"]] == list(ORDER.effects)
    path = tmp_path / "keys" / "0007.json"
    path.write_text(json.dumps(key | {"effects": []}))
    with pytest.raises(RunDirectoryError, match="was changed"):
        read_key(tmp_path, 7, commitment)


@pytest.mark.parametrize("number", range(4))
def test_a_zero_error_of_the_stage_is_no_re_mount_like_the_others(rig_truth, number):
    key = make_case(rig_truth, Order(number, "emaws-rig", ("distance_offset",), 1.0, 3)).key
    mounts = key["plan"]["runs"] * key["plan"]["mounts_per_run"]
    assert key["effects"][0]["size"] >= 3.99 * key["plan"]["mount_m"] / mounts**0.5
