"""``femfit compare`` as users type it: a law, the reference and an imported table alike."""

import json

import pytest

from femfit.model.json_file import write_model
from support.campaign import campaign
from support.command import femfit


@pytest.fixture(scope="module")
def files(levitation_model, tmp_path_factory):
    folder = tmp_path_factory.mktemp("compare")
    write_model(levitation_model, folder / "model.json")
    campaign(levitation_model, 41, distances=6, currents=5).rows.to_csv(folder / "bench.csv", index=False)
    rows = ["current_A,distance_m,force_N,flux_linkage_Wb"]
    for k in range(8):
        for j in range(25):
            d, i = 0.015 + 0.00125 * j, 0.2 * k
            force = levitation_model.magnetics.force(d, i)
            rows.append(f"{i},{d},{float(force)!r},{float(levitation_model.magnetics.flux_linkage(d, i))!r}")
    (folder / "table.csv").write_text("\n".join(rows))
    return folder


def test_a_model_that_holds_agrees_and_the_json_has_its_maps(files):
    done = femfit(
        "compare",
        files / "model.json",
        files / "bench.csv",
        "--json",
        files / "c.json",
        "--pictures",
        files / "pictures",
    )
    assert done.returncode == 0, done.stderr
    assert "agrees with these data within their noise" in done.stdout
    data = json.loads((files / "c.json").read_text())
    assert data["verdict"] == "agrees"
    assert {one["channel"] for one in data["channels"]} == {"force_N", "flux_linkage_Wb", "hall_V", "voltage_V"}
    assert {len(one["mean"]) == len(one["readings"]) for one in data["maps"]} == {True}
    assert (files / "pictures" / "misfit-maps.png").stat().st_size > 10_000
    assert (files / "pictures" / "misfit-force_N-1.png").is_file()


def test_the_noise_of_a_single_sweep_is_declared_by_an_option(files, levitation_model):
    campaign(levitation_model, 41, runs=1, mount_m=0.0).rows.to_csv(files / "single.csv", index=False)
    said = ("--noise", "force_N=4e-4", "--noise", "hall_mV=3")
    done = femfit("compare", files / "model.json", files / "single.csv", *said, "--json", files / "n.json")
    assert done.returncode == 0, done.stderr
    noise = {one["channel"]: one for one in json.loads((files / "n.json").read_text())["channels"]}
    assert noise["force_N"]["noise_source"] == noise["hall_V"]["noise_source"] == "declared"
    assert (noise["force_N"]["noise_floor"], noise["hall_V"]["noise_floor"]) == pytest.approx((4e-4, 3e-3))
    wrong = femfit("compare", files / "model.json", files / "single.csv", "--noise", "force_N=little")
    assert "--noise must be" in wrong.stderr
    assert "force_N" in femfit("compare", files / "model.json", files / "single.csv", "--noise", "forc_N=1").stderr


def test_an_imported_table_is_compared_through_its_coenergy(files):
    done = femfit("compare", files / "table.csv", files / "bench.csv")
    assert done.returncode == 0, done.stderr
    assert "agrees with these data within their noise" in done.stdout
    assert "Hall output" not in done.stdout


def test_a_missing_file_is_an_error_with_a_remedy(files):
    done = femfit("compare", files / "model.json", files / "nothing.csv")
    assert done.returncode == 1
    assert "There is no measurement" in done.stderr


def test_columns_and_units_are_said_by_options(files):
    foreign = (files / "bench.csv").read_text().replace("force_N", "Kanal 3", 1).replace("distance_m", "Weg", 1)
    (files / "foreign.csv").write_text(foreign)
    said = ("--column", "Kanal 3=force_N", "--unit", "Kanal 3=N", "--unit", "Weg=m")
    done = femfit("compare", files / "model.json", files / "foreign.csv", *said, "--json", files / "said.json")
    assert done.returncode == 0, done.stderr
    assert "force_N" in {one["channel"] for one in json.loads((files / "said.json").read_text())["channels"]}
    assert "--unit must be" in femfit("compare", files / "model.json", files / "foreign.csv", "--unit", "Weg").stderr
