"""A pole face that was turned too deep: a device solved anew, its readings, and what is said of them.

The rim and the cone stand 0.15 mm deeper than drawn, a third of the smallest distance: the gap grows by as much, so
that the readings cannot tell a deeper pole from distances that are recorded too small.
"""

import json
import tomllib

import numpy as np
import pytest

import femfit as ff
from femfit.device.drawn_numbers import numbers_from_toml
from femfit.device.load import actuator_from_toml
from femfit.effects.effect import AddedEffect
from femfit.field.sweep import run_sweep
from femfit.model.with_effects import with_effects
from support.command import femfit
from support.conical import CONICAL, at_distances, moved

POLE = "fixed.regions.frame.polygon_mm[8..10][1]"
CONE_END = "fixed.regions.frame.polygon_mm[10][1]"
DEEPER = -0.15
NOISE_N, NOISE_WB = 0.02, 2e-4


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    directory = tmp_path_factory.mktemp("conical")
    (directory / "conical.toml").write_text(CONICAL, encoding="utf-8")
    return directory


@pytest.fixture(scope="module")
def built(place):
    """The sweep of the device as it was built."""
    text = at_distances(moved(DEEPER), "[0.5, 0.7, 1, 1.5, 2.2]")
    return run_sweep(actuator_from_toml(text), place / "built", workers=1).rows


@pytest.fixture(scope="module")
def bench(place, built):
    rng, rows = np.random.default_rng(4), built[["distance_m", "current_A"]]
    noises = {"force_N": NOISE_N, "flux_linkage_Wb": NOISE_WB}
    for run in (1, 2):
        read = {name: built[name] + sd * rng.standard_normal(len(built)) for name, sd in noises.items()}
        rows.assign(run=run, **read).to_csv(
            place / "bench.csv", mode="w" if run == 1 else "a", header=run == 1, index=False
        )
    return place / "bench.csv"


@pytest.fixture(scope="module")
def model(place):
    """Fitted to the sweep of the drawing, which stands where ``femfit calibrate`` looks for it."""
    done = femfit("sweep", place / "conical.toml", "-o", place / "runs" / "drawn", "--workers", 1, "--signatures")
    assert done.returncode == 0, done.stderr
    assert "frame: pole face at z = 5 mm with its cone +- 0.05" in done.stdout
    done = femfit("fit", place / "runs" / "drawn", "--model", "coenergy", "-o", place / "model.json")
    assert done.returncode == 0, done.stderr
    return place / "model.json"


def test_the_slope_of_a_face_is_the_sum_of_those_of_its_corners(model, place):
    """To first order corners that move together add: what a sweep writes of three numbers is of one field."""
    signatures = ff.read_sweep(place / "runs" / "drawn").signatures
    rows = {one.key: signatures.of(one) for one in signatures.numbers}
    for channel in ("force_N", "flux_linkage_Wb"):
        parts = rows["fixed.regions.frame.polygon_mm[8][1]"][channel] + rows[CONE_END][channel]
        assert rows[POLE][channel].to_numpy() == pytest.approx(parts.to_numpy(), rel=1e-6, abs=1e-9)


def test_the_slope_of_a_face_is_that_of_whole_new_sweeps(model, place):
    """Of drawings with the pole 20 um deeper and higher, within what their meshes differ by."""
    step, ends = 0.02, []
    for sign in (1.0, -1.0):
        text = (
            at_distances(moved(sign * step), "[0.78, 1.8]")
            .replace("[0.15, 0.25, 0.3]", "[0.3]")
            .replace("5e-3", "1e-3")
        )
        ends.append(run_sweep(actuator_from_toml(text), place / f"end{sign:+.0f}", workers=1).rows)
    (pole,) = (one for one in ff.read_sweep(place / "runs" / "drawn").signatures.numbers if one.key == POLE)
    slopes = ff.read_sweep(place / "runs" / "drawn").signatures.of(pole)
    slopes = slopes[(slopes["current_A"] == 0.3) & slopes["distance_m"].isin([0.78e-3, 1.8e-3])]
    for channel in ("force_N", "flux_linkage_Wb"):
        difference = (ends[0][channel] - ends[1][channel]).to_numpy() / (2.0 * step)
        assert slopes[channel].to_numpy() == pytest.approx(difference, rel=0.02)


def test_a_face_at_the_gap_acts_as_the_distance_does(model, built):
    """0.15 mm of 0.5 mm are far beyond the first order; what the model makes of it is compared with a new field."""
    drawn = ff.read_model(model)
    (pole,) = (one for one in drawn.drawn if one.key == POLE)
    assert pole.gap_m == pytest.approx(1e-3, rel=0.03)  # per mm
    changed = with_effects(drawn, [AddedEffect(pole.effect, {pole.parameter: DEEPER})])
    d, i = built["distance_m"].to_numpy(), built["current_A"].to_numpy()
    left, before = (
        np.sqrt(np.mean((np.array([one.force(*at) for at in zip(d, i, strict=True)]).ravel() - built["force_N"]) ** 2))
        for one in (changed, drawn)
    )
    assert left < 0.01 * before


def test_a_deeper_pole_is_among_the_causes_of_readings_that_it_would_give(model, bench, place):
    done = femfit("diagnose", model, bench, "--json", place / "found.json", "--bootstrap", "0")
    assert done.returncode == 0, done.stderr
    found = json.loads((place / "found.json").read_text(encoding="utf-8"))
    (missing,) = found["missing"]
    assert {"distance_offset", POLE} <= set(missing["class"])
    assert found["confident"] is False
    assert "the frame's pole face at z = 5 mm with its cone" in done.stdout


@pytest.mark.long
def test_a_face_is_calibrated_by_its_name_and_written_with_all_its_corners(model, bench, place):
    done = femfit(
        "calibrate", place / "conical.toml", bench, "--numbers", "frame: pole face at z = 5 mm", "-o",
        place / "new.toml", "--runs", place / "runs", "--json", place / "calibrated.json", "--workers", 1,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (number,) = json.loads((place / "calibrated.json").read_text(encoding="utf-8"))["numbers"]
    assert number["key"] == POLE
    assert number["sd_as_drawn"] < 0.02
    for value, sd in ((number["value"], number["sd_as_drawn"]), number["by_data"]):
        assert abs(value - (5.0 + DEEPER)) < 2.0 * sd
    text = (place / "new.toml").read_text(encoding="utf-8")
    corners = tomllib.loads(text)["fixed"]["regions"]["frame"]["polygon_mm"]
    change = round(number["value"] - 5.0, 9)
    assert [z for _, z in corners[8:]] == pytest.approx([5.0 + change, 5.0 + change, 0.1111 + change])
    assert corners[:8] == tomllib.loads(CONICAL)["fixed"]["regions"]["frame"]["polygon_mm"][:8]
    assert "# turned in one setting" in text


def test_signatures_that_know_no_faces_are_still_read(model, place, tmp_path):
    """As sweeps of before have them: by key paths alone."""
    source, older = place / "runs" / "drawn", tmp_path / "older"
    older.mkdir()
    for file in source.iterdir():
        (older / file.name).write_bytes(file.read_bytes())
    data = json.loads((source / "signatures.json").read_text(encoding="utf-8"))
    fields = ("key", "also", "kind", "value", "unit", "tolerance", "effect")
    data["numbers"] = [{key: one[key] for key in fields} for one in data["numbers"] if ".." not in one["key"]]
    (older / "signatures.json").write_text(json.dumps(data), encoding="utf-8")
    fitted = ff.fit_model(ff.read_sweep(older)).model
    keys = {one.facts.key for one in numbers_from_toml(CONICAL) if not one.facts.effect and not one.facts.is_contour}
    assert keys >= {one.key for one in fitted.drawn} >= {CONE_END}
