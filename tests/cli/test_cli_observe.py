"""``femfit observe`` prints the answer first and writes what it is asked for."""

import json

import pytest

import femfit as ff
from femfit.model.json_file import read_model, write_model
from support.command import femfit
from tests.support.replays import TRUE, damped, logs


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("observe")
    write_model(damped({**TRUE, "laser": 1e-5}), folder / "model.json")
    record = logs(1500, 1, seed=8)[1][0].rows
    record[["time_s", "voltage_V", "current_A", "distance_m"]].to_csv(folder / "log.csv", index=False)
    return folder


def test_estimate_picture_result_and_noise_are_written(folder):
    done = femfit(
        "observe", folder / "model.json", folder / "log.csv", "--filter", "ukf,ekf", "--sensors", "current,laser",
        "--csv", folder / "seen.csv", "--picture", folder / "seen.png", "--json", folder / "seen.json",
        "--write-noise", folder / "tuned.json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("ukf: not consistent")
    assert (folder / "seen.png").stat().st_size > 10_000
    header = (folder / "seen.csv").read_text().splitlines()[0]
    assert {"ukf_distance_m", "ekf_deviation_distance_m", "ukf_innovation_laser"} <= set(header.split(","))
    result = json.loads((folder / "seen.json").read_text())
    assert [one["name"] for one in result["filters"]] == ["ukf", "ekf"]
    tuned = read_model(folder / "tuned.json")
    assert ff.observe(tuned, folder / "log.csv", find=False).filters[0].trusted
    again = femfit("observe", folder / "model.json", folder / "log.csv", "--csv", folder / "seen.csv", "--keep-noise")
    assert again.returncode == 0, again.stderr


def test_a_bench_table_is_refused(folder):
    (folder / "bench.csv").write_text("distance_m,current_A,force_N\n0.002,0.5,1.0\n0.003,0.5,0.5\n")
    done = femfit("observe", folder / "model.json", folder / "bench.csv")
    assert done.returncode != 0
    assert "time_s" in done.stderr
