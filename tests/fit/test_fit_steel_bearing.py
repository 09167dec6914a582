"""A bearing whose steel saturates, from its sweep to its model: by the command, against its closed form."""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.core.errors import DomainError, FitError
from femfit.fit.rows import rows_of_table
from support.bearing import grid
from support.command import femfit
from support.reference import REFERENCE, needs_reference
from support.saturating_bearing import CIRCUIT, DISTANCES, GAP, KIND, force, inductance, share, write_sweep

ONE_SIDE, BOTH_SIDES = np.array([0.0, 1.0, 2.0, 3.0]), np.array([-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0])
BETWEEN = grid(np.linspace(0.21e-3, 0.79e-3, 9), np.linspace(0.0, 2.9, 6), np.linspace(0.0, 2.9, 6))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Swept from 0 A up, and fitted by the command."""
    folder = write_sweep(tmp_path_factory.mktemp("bearing") / "sweep", ONE_SIDE, ONE_SIDE)
    told = femfit("fit", folder, "-o", folder / "model.json", "--json", folder / "fit.json")
    assert told.returncode == 0, told.stderr
    return folder


@pytest.fixture(scope="module")
def model(folder):
    return ff.read_model(folder / "model.json")


def test_the_device_saturates_so_that_no_quadratic_form_is_near_it():
    ends = np.array([[0.1, 0.0], [3.0, 0.0]])
    first, last = force(np.array([0.2e-3, 0.2e-3]), ends) / ends[:, 0] ** 2
    assert last < 0.8 * first


def test_each_point_and_what_lies_between_is_met_relative_to_its_own_force(model):
    for (d, i), most in ((grid(DISTANCES, ONE_SIDE, ONE_SIDE), 0.03), (BETWEEN, 0.05)):
        missed = share(model.force(d, i), force(d, i))
        assert missed.max() < most
        assert np.sqrt(np.mean(missed**2)) < 0.01


def test_without_current_there_is_no_force_and_all_currents_reversed_give_the_same(model):
    d = np.linspace(0.2e-3, 0.8e-3, 25)
    largest = force(0.2e-3, np.array([3.0, 0.0]))
    assert np.abs(model.force(d, np.zeros((25, 2)))).max() < 1e-12 * largest
    assert np.abs(model.flux_linkage(d, np.zeros((25, 2)))).max() < 1e-12
    d, i = BETWEEN
    np.testing.assert_allclose(model.force(d, -i), model.force(d, i), atol=1e-12 * largest)
    np.testing.assert_allclose(model.flux_linkage(d, -i), -model.flux_linkage(d, i), atol=1e-12)


def test_seen_from_the_other_side_the_bearing_is_the_same(model):
    d, i = BETWEEN
    assert share(-model.force(GAP - d, i[:, ::-1]), model.force(d, i)).max() < 2e-3


def test_the_inductances_are_positive_definite_and_near_their_closed_form(model):
    d, i = BETWEEN
    found = model.inductance(d, i)
    assert np.linalg.eigvalsh(found).min() > 0.0
    own = np.diagonal(inductance(d, i), axis1=1, axis2=2)
    assert np.abs(np.diagonal(found, axis1=1, axis2=2) - own).max() < 0.05 * own.max()


def test_signs_that_were_not_swept_together_are_outside_and_said(folder, model):
    assert model.force(0.5e-3, [-1.0, -2.0]) == pytest.approx(model.force(0.5e-3, [1.0, 2.0]), abs=1e-9)
    with pytest.raises(DomainError, match="reversed"):
        model.force(0.5e-3, [1.0, -1.0])
    notes = json.loads((folder / "fit.json").read_text())["notes"]
    assert any("both sides of 0 A" in note for note in notes)
    assert "mirrored" in json.loads((folder / "model.json").read_text())["validity"]


def test_one_circuit_swept_to_both_sides_makes_the_model_valid_for_every_sign(tmp_path):
    fit = ff.fit_model(write_sweep(tmp_path / "sweep", ONE_SIDE, BOTH_SIDES))
    np.testing.assert_array_equal(fit.model.validity.current_limits_A, [[-3.0, 3.0], [-3.0, 3.0]])
    assert not fit.model.validity.mirrored
    d, i = grid(np.linspace(0.25e-3, 0.75e-3, 5), np.linspace(-2.9, 2.9, 7), np.linspace(-2.9, 2.9, 7))
    missed = share(fit.model.force(d, i), force(d, i))
    assert missed.max() < 0.1  # where both magnets nearly cancel, between steps of 1 A over a knee
    assert np.sqrt(np.mean(missed**2)) < 0.02


def test_currents_over_a_knee_too_far_apart_are_refused_with_those_to_add(tmp_path):
    coarse = write_sweep(tmp_path / "sweep", np.array([0.0, 10.0, 20.0]), BOTH_SIDES)
    with pytest.raises(FitError, match="currents 5 and 15 A of bottom"):
        ff.fit_model(coarse)


def test_settings_that_differ_by_rounding_are_one(folder):
    table = ff.read_sweep(folder)
    jitter = 1.0 + 1e-9 * np.random.default_rng(1).uniform(-1.0, 1.0, len(table.rows))
    rounded = replace(table, rows=table.rows.assign(distance_m=table.rows["distance_m"] * jitter))
    assert len(np.unique(rounded.rows["distance_m"])) > len(DISTANCES)
    np.testing.assert_allclose(rows_of_table(rounded).distances, DISTANCES, rtol=1e-8)


def test_two_currents_that_cannot_show_how_iron_bends_are_refused(tmp_path):
    with pytest.raises(FitError, match="3 currents"):
        ff.fit_model(write_sweep(tmp_path / "sweep", np.array([0.0, 3.0]), np.array([0.0, 3.0])))


def test_points_that_failed_are_counted_before_any_are_asked_for(folder, tmp_path):
    holes = tmp_path / "holes"
    shutil.copytree(folder, holes)
    rows = pd.read_csv(folder / "sweep.csv")
    rows.loc[[20, 50, 80], "status"] = "failed: no mesh"
    rows.to_csv(holes / "sweep.csv", index=False)
    (note,) = (note for note in ff.fit_model(holes).notes if "points of the grid" in note)
    assert note.startswith(f"3 of the {len(rows)} ")


def test_voltages_reversed_together_move_it_as_they_do_forwards(model):
    forwards, backwards = (
        ff.simulate(model, voltage_V={"bottom": sign * 5.0, "top": sign * 4.0}, start_m=0.5e-3, duration_s=1.2e-3)
        for sign in (1.0, -1.0)
    )
    assert backwards.table["time_s"][-1] == pytest.approx(1.2e-3)
    np.testing.assert_allclose(backwards.table["distance_m"][-1], forwards.table["distance_m"][-1], rtol=1e-9)


def test_an_audit_finds_a_quadratic_form_with_terms_of_magnets_wrong(folder):
    """As models of such devices were fitted before: a quadratic form with linear terms, valid for either sign."""
    right = json.loads((folder / "model.json").read_text())
    wrong, d = right | {"name": "as-before"}, DISTANCES
    knots = [0.2, 0.2, 0.2, 0.8, 0.8, 0.8]
    inverse = {"coordinate": "distance", "reference_distance_m": 1e-3, "u_knots": knots, "u_degree": 2}
    own = inductance(d[[0, 3, 6]], np.zeros((3, 2)))
    entries = [[0.002 * k, 3e-4 * k, -2e-4 * k, own[k, 0, 0], own[k, 0, 1], own[k, 1, 1]] for k in range(3)]
    wrong["magnetics"] = {
        "kind": "coenergy_matrix", "circuits": ["bottom", "top"], **inverse, "coefficients": entries,
    }  # fmt: skip
    wrong["validity"] = {key: value for key, value in right["validity"].items() if key != "mirrored"} | {
        "current_min_A": -3.0, "further_A": [[-3.0, 3.0]],
    }  # fmt: skip
    (folder / "before.json").write_text(json.dumps(wrong))
    told = femfit("audit", folder / "before.json", "--json", folder / "before-audit.json")
    assert told.returncode == 1
    found = json.loads((folder / "before-audit.json").read_text())["findings"]
    assert {"point_misfit", "force_without_current", "evenness"} <= {
        one["code"] for one in found if one["severity"] == "wrong"
    }
    assert femfit("audit", folder / "model.json", "--json", folder / "audit.json").returncode == 0
    found = {one["code"]: one for one in json.loads((folder / "audit.json").read_text())["findings"]}
    assert {found[code]["severity"] for code in ("point_misfit", "force_without_current", "evenness")} == {"holds"}


def test_a_loop_holds_the_bearing_and_its_record_is_observed(folder, tmp_path):
    told = femfit(
        "simulate", folder / "model.json", "--runs", 1, "--seconds", 0.05, "--controller", "state-feedback",
        "--csv", tmp_path / "loop.csv",
    )  # fmt: skip
    assert told.returncode == 0, told.stderr
    assert "Held: 1 of 1" in told.stdout
    told = femfit("observe", folder / "model.json", tmp_path / "loop.csv")
    assert told.returncode == 0, told.stderr


def test_voltages_move_it_and_energy_is_kept(model):
    moved = ff.simulate(model, voltage_V={"bottom": 1.2, "top": 0.4}, start_m=0.5e-3, duration_s=4e-3)
    assert not moved.extrapolated
    assert moved.table["distance_m"][-1] < 0.5e-3


def test_a_bench_of_the_device_itself_fits_and_one_of_more_turns_does_not(model, tmp_path):
    d, i = grid(np.linspace(0.25e-3, 0.75e-3, 6), [0.5, 1.5, 2.5], [0.5, 1.5, 2.5])
    noise = 0.2 * np.random.default_rng(1).standard_normal((2, len(d)))  # in N
    head = "run,distance_m,current_bottom_A,current_top_A,force_N\n"
    for name, scale in (("same", 1.0), ("more", 1.08)):
        pulled = force(d, i * [scale, 1.0])
        rows = [
            f"{run + 1},{a},{b[0]},{b[1]},{c}\n"
            for run in range(2)
            for a, b, c in zip(d, i, pulled + noise[run], strict=True)
        ]
        (tmp_path / f"{name}.csv").write_text(head + "".join(rows))
    same, more = (ff.compare(model, tmp_path / f"{name}.csv") for name in ("same", "more"))
    assert same.channels[0].rms < 0.5  # the noise and what the fit misses between the points
    assert more.channels[0].rms > 1.0
    assert ff.diagnose(model, tmp_path / "more.csv").to_dict()["verdict"] != same.verdict


@pytest.mark.nightly
@needs_reference
def test_a_swept_bearing_of_steel_1010_is_met_at_every_point(tmp_path):
    drawing = REFERENCE / "strangers" / "amb2.toml"
    assert femfit("sweep", drawing, "-o", tmp_path / "sweep").returncode == 0
    fit = ff.fit_model(tmp_path / "sweep")
    rows = ff.read_sweep(tmp_path / "sweep").valid_rows()
    d, i = rows["distance_m"].to_numpy(), rows[["current_bottom_A", "current_top_A"]].to_numpy()
    missed = share(fit.model.force(d, i), rows["force_N"].to_numpy())
    assert missed.max() < 0.03
    assert np.sqrt(np.mean(missed**2)) < 0.01
    assert fit.circuits.left_out_worst < 0.05
    assert share(-fit.model.force(1e-3 - d, i[:, ::-1]), fit.model.force(d, i)).max() < 2e-3


def write_shared_core(folder, currents, leakage_H):
    """Two windings of as many turns on one core that saturates, W' = E (sqrt(1 + q^2) - 1) + l (i_1^2 + i_2^2) / 2."""
    energy, reach = 0.12, 0.15e-3
    d, i = grid(np.array([0.2, 0.5, 0.9, 1.4, 2.0]) * 1e-3, currents, currents)
    per_ampere = 2.0 * reach / (d + reach)
    q = per_ampere * i.sum(axis=1)
    common = energy * per_ampere**2 * (1.0 + q**2) ** -1.5
    rows = {"distance_m": d, "force_N": energy * q**2 / np.sqrt(1.0 + q**2) / (d + reach), "status": "ok"}
    for k, name in enumerate(("pull", "hold")):
        rows[f"current_{name}_A"] = i[:, k]
        rows[f"flux_linkage_{name}_Wb"] = energy * q / np.sqrt(1.0 + q**2) * per_ampere + leakage_H * i[:, k]
        rows[f"inductance_{name}_H"] = common + leakage_H
    rows["inductance_pull_hold_H"] = common
    entry = {"name": "holdpull", "kind": KIND, "circuits": [{"name": name, **CIRCUIT} for name in ("pull", "hold")]}
    folder.mkdir()
    pd.DataFrame(rows).to_csv(folder / "sweep.csv", index=False)
    (folder / "manifest.json").write_text(json.dumps({"kind": "sweep", "name": "holdpull", "actuator": entry}))
    return folder


def test_windings_that_share_a_core_are_refused_for_their_coupling_and_not_for_their_currents(tmp_path):
    folder = write_shared_core(tmp_path / "sweep", np.linspace(-2.0, 2.0, 5), 2e-3)
    told = femfit("fit", folder, "-o", tmp_path / "model.json")
    assert told.returncode == 1
    assert "share one core" in told.stderr
    assert "one winding at a time" in told.stderr
    assert "more currents" not in told.stderr


def test_windings_apart_that_are_swept_too_coarsely_do_not_share_a_core(tmp_path):
    coarse = np.array([0.0, 20.0, 40.0])
    told = femfit("fit", write_sweep(tmp_path / "sweep", coarse, coarse), "-o", tmp_path / "model.json")
    assert told.returncode == 1
    assert "share one core" not in told.stderr
    assert "Sweep more currents" in told.stderr


def test_what_whole_distances_left_out_miss_is_printed_and_both_halves_of_a_mirror_are_refined(tmp_path):
    """Five distances leave the force between them open by more than points left out show, which keep the others."""
    folder = write_sweep(tmp_path / "sweep", ONE_SIDE, ONE_SIDE, distances=np.linspace(0.12e-3, 0.88e-3, 5))
    told = femfit("fit", folder, "-o", tmp_path / "model.json")
    assert told.returncode == 0, told.stderr
    of_points, of_distances, _ = map(float, re.findall(r"([\d.]+) % at most", told.stdout))
    d, i = grid(np.linspace(0.12e-3, 0.88e-3, 33), ONE_SIDE, ONE_SIDE)
    between = 100.0 * share(ff.read_model(tmp_path / "model.json").force(d, i), force(d, i)).max()
    assert between > 10.0 * of_points
    assert between < 4.0 * of_distances
    (note,) = (note for note in ff.fit_model(folder).notes if "too coarse" in note)
    assert "whole distance left out" in note
    assert "from one distance to the next" in note
    added = [float(x) for x in re.findall(r"\d+\.\d+", note.partition("distances")[2].partition(" mm")[0])]
    assert len(added) > 1
    np.testing.assert_allclose(np.sort(added), np.sort(1.0 - np.array(added)), atol=1e-9)


def test_a_sweep_fine_in_the_distance_is_not_called_too_coarse(folder):
    assert "too coarse" not in str(json.loads((folder / "fit.json").read_text())["notes"])
