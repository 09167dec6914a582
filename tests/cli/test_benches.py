"""Tables as labs write them, through fit, compare, diagnose, suggest, add and bench."""

import json
import tomllib

import numpy as np
import pandas as pd
import pytest

from femfit.effects.catalogue import all_effects
from femfit.effects.effect import AddedEffect
from femfit.identify.bench import placed
from femfit.identify.noise.components import estimate_noise
from femfit.model.json_file import read_model, write_model
from femfit.tables.sweep_table import write_sweep_table
from support.campaign import campaign
from support.cli_case import hidden_effect, plateaus
from support.command import femfit
from support.impedances import impedance_file
from support.sweeps import full_table

SIGMA = 1e-3


@pytest.fixture(scope="module")
def folder(levitation_model, tmp_path_factory):
    folder = tmp_path_factory.mktemp("benches")
    write_model(levitation_model, folder / "model.json")
    size = {"distances": 6, "currents": 5}
    hall = hidden_effect("hall_offset", offset_V=0.02)
    campaign(levitation_model, 31, [hall], **size).rows.to_csv(folder / "hall.csv", index=False)
    return folder


def worked(folder, line, *options):
    """A command in the folder, and its result as JSON."""
    done = femfit(*line.split(), *options, "--json", "result.json", cwd=folder)
    assert done.returncode == 0, done.stderr
    return json.loads((folder / "result.json").read_text())


def compared(folder, rows, *options):
    """The JSON of a comparison, and its channels by name."""
    rows.to_csv(folder / "rows.csv", index=False)
    data = worked(folder, "compare model.json rows.csv", *options)
    return data, {one["channel"]: one for one in data["channels"]}


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    directory = tmp_path_factory.mktemp("sweep")
    write_sweep_table(full_table(), directory)
    return directory


def test_the_coenergy_is_the_default_and_lies_beside_the_table(sweep):
    assert femfit("fit", sweep / "sweep.parquet").returncode == 0
    assert read_model(sweep / "model_coenergy.json").misfit.force_rms_relative < 1e-3


def test_a_law_is_written_where_asked(sweep, tmp_path):
    data = worked(tmp_path, f"fit {sweep} --model F1e -o deep/m.json")
    assert (data["model"], data["model_file"]) == ("F1e", "deep/m.json")
    assert read_model(tmp_path / "deep" / "m.json").magnetics.law_name == "F1e"


def test_the_noise_of_a_single_sweep_is_declared_by_an_option(folder, levitation_model):
    rows = campaign(levitation_model, 41, runs=1, mount_m=0.0, distances=6, currents=5).rows
    _, noise = compared(folder, rows, "--noise", "force_N=4e-4", "--noise", "hall_mV=3")
    assert noise["force_N"]["noise_source"] == noise["hall_V"]["noise_source"] == "declared"
    assert (noise["force_N"]["noise_floor"], noise["hall_V"]["noise_floor"]) == pytest.approx((4e-4, 3e-3))


def test_an_imported_table_is_compared_through_its_coenergy(folder, levitation_model):
    d, i = (axis.ravel() for axis in np.meshgrid(0.015 + 0.00125 * np.arange(25), 0.2 * np.arange(8)))
    read = {"force_N": levitation_model.force(d, i), "flux_linkage_Wb": levitation_model.flux_linkage(d, i)}
    pd.DataFrame({"current_A": i, "distance_m": d} | read).to_csv(folder / "table.csv", index=False)
    campaign(levitation_model, 41, distances=6, currents=5).rows.to_csv(folder / "clean.csv", index=False)
    data = worked(folder, "compare table.csv clean.csv")
    assert data["verdict"] == "agrees"
    assert "hall_V" not in {one["channel"] for one in data["channels"]}


def passes(model, seed, count):
    """Passes over 20 settings with white noise of the force, without a column that says which pass or when."""
    box = model.validity
    d, i = np.meshgrid(np.linspace(0.0165, 0.0435, 5), np.linspace(box.current_min_A, box.current_max_A, 4))
    force = np.tile(model.force(d.ravel(), i.ravel()), count)
    read = force + SIGMA * np.random.default_rng(seed).standard_normal(len(force))
    return pd.DataFrame(
        {"distance_m": np.tile(d.ravel(), count), "current_A": np.tile(i.ravel(), count), "force_N": read}
    )


@pytest.mark.parametrize(("count", "order", "seeds"), [(2, "as measured", 10), (2, "shuffled", 10), (4, "sorted", 10)])
def test_the_white_noise_of_passes_without_a_run_column_is_found(levitation_model, folder, count, order, seeds):
    """20 differences know a standard deviation to 16 %: 89 of 100 lie within a quarter of the truth."""
    ratios = []
    for seed in range(seeds):
        rows = passes(levitation_model, seed, count)
        rows = rows.sort_values(["distance_m", "current_A"], kind="stable") if order == "sorted" else rows
        rows = rows.sample(frac=1.0, random_state=seed) if order == "shuffled" else rows
        rows.to_csv(folder / "passes.csv", index=False)
        (sigma,) = estimate_noise(placed(levitation_model, folder / "passes.csv")).sigma
        ratios.append(sigma / SIGMA)
    within = np.abs(np.array(ratios) - 1.0) <= 0.25
    assert within.sum() >= 0.9 * seeds, ratios
    assert max(ratios) < 1.4


def test_suggest_answers_for_a_plan_and_asks_for_repeats_where_no_noise_is_known(folder):
    rows = [f"1,{k},{0.2 * (k % 7)},{0.016 + 0.002 * (k // 7)},1,\n" for k in range(70)]
    (folder / "plan.csv").write_text("run,order,current_A,distance_m,branch,force_N\n" + "".join(rows))
    done = femfit("suggest", "model.json", "--plan", "plan.csv", "--verbose", cwd=folder)
    (line,) = (line for line in done.stdout.splitlines() if line.endswith("lack hall_V"))
    assert "hall_offset" in line
    lines = (folder / "hall.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    (folder / "few.csv").write_text("".join(lines[:6]), encoding="utf-8")
    assert "twice" in femfit("suggest", "model.json", "few.csv", cwd=folder).stdout


def test_impedances_without_a_column_of_the_distance_take_it_from_an_option(folder, levitation_model):
    lag = AddedEffect(all_effects()["eddy_current_lag"], {"ring_share": 0.2, "diffusion_share": 0.0, "time_s": 2e-3})
    rows = pd.read_csv(impedance_file(levitation_model, folder / "z.csv", [lag]))
    rows = rows[(rows["gap [mm]"] == rows["gap [mm]"].min()) & (rows["Bias [A]"] == 0.0)]
    rows.drop(columns=["gap [mm]", "Bias [A]"]).to_csv(folder / "one.csv", index=False)
    data = worked(folder, f"compare model.json one.csv --setting distance_mm={rows['gap [mm]'].iloc[0]}")
    assert {"resistance_ohm", "inductance_H"} >= {one["channel"] for one in data["channels"]} != set()


def test_a_gap_is_said_and_noted(folder, levitation_model):
    rows = plateaus(levitation_model).reset_index(drop=True)
    rows.loc[200:202, "coil_voltage_V"] = np.nan
    rows.to_csv(folder / "gap.csv", index=False)
    said = worked(folder, "bench gap.csv -o b.csv")["findings"]
    assert [one["code"] for one in said] == ["gap"]
    assert "1 gap" in tomllib.loads((folder / "b.toml").read_text())["notes"]
