"""A drawing's wrong numbers, and its faces, are found from readings of a device whose field was solved anew."""

import json
import re
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.core.errors import ActuatorFileError, TableError, UsageError
from femfit.device.drawn_numbers import numbers_from_toml
from femfit.device.load import actuator_from_toml
from femfit.effects.catalogue import effect_by_name
from femfit.identify.add_effects import whitening_beside
from femfit.identify.bench import placed
from femfit.identify.calibration import calibrate as calibration
from femfit.identify.calibration.calibrate import _diagnosed, _moved
from femfit.identify.calibration.fit import Redrawn, estimate
from femfit.identify.calibration.numbers import Choice, Drawing, with_named
from femfit.identify.calibration.result import CalibratedNumber, remarks, verdict
from femfit.identify.decision.campaign import considered_effects, gather
from femfit.identify.lack_of_fit import LackOfFit
from femfit.tables.measurement_file import read_bench_table
from support.actuators import GEOMETRY
from support.command import femfit
from support.small_drawing import CONICAL, SMALL, at_distances, moved

HEIGHT, IRON = "moving.regions.magnet.z_mm[1]", "materials.iron.relative_permeability"
TRUE_HEIGHT, TRUE_IRON = 4.07, 430.0
OFFSET = 0.004
DISTANCES = "{ start = 4, stop = 12, step = 1 }"
BASE = SMALL.replace('kind = "hall"', 'kind = "hall"\nsensitivity_V_per_T = 10')
DRAWN = BASE.replace("z_mm = [0, 4]", "z_mm = [0, 4] # by the caliper")
TRUE = BASE.replace("z_mm = [0, 4]", f"z_mm = [0, {TRUE_HEIGHT}]").replace("= 500", f"= {TRUE_IRON}")
NOISE = {"force_N": 5e-5, "flux_linkage_Wb": 1e-7, "hall_V": 2e-4}


def readings(rows, seed=1, runs=3, offset=OFFSET, noise=NOISE):
    """What a bench reads of a swept field, its Hall element off by a constant."""
    rng, settings = np.random.default_rng(seed), rows[["distance_m", "current_A"]]
    true = rows.assign(hall_V=2.5 + offset + 10.0 * rows["hall_T"]) if "hall_V" in noise else rows
    tables = []
    for run in range(1, runs + 1):
        read = {name: true[name] + sd * rng.standard_normal(len(rows)) for name, sd in noise.items()}
        tables.append(settings.assign(run=run, **read))
    return pd.concat(tables)


def field_of(text, directory, distances=DISTANCES):
    """Rows of the sweep of a drawing."""
    return ff.run_sweep(actuator_from_toml(text.replace(DISTANCES, distances)), directory, workers=1).rows


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """The drawing, and the sweep of the device that was built; sweeps of the drawing as drawn are shared."""
    directory = tmp_path_factory.mktemp("calibration")
    (directory / "small.toml").write_text(DRAWN)
    return directory


@pytest.fixture(scope="module")
def built(place):
    return field_of(TRUE, place / "built")


@pytest.fixture(scope="module")
def bench(place, built):
    readings(built).to_csv(place / "bench.csv", index=False)
    return place / "bench.csv"


@pytest.fixture(scope="module")
def found(place, bench):
    return ff.calibrate(place / "small.toml", bench, place / "runs", numbers=[HEIGHT, IRON], workers=1)


def test_two_numbers_are_found_beside_an_effect_that_is_none_and_the_error_on_runs_left_out_falls(found):
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
    assert found.lack_of_fit.p_value > 0.01
    for one in found.unseen.channels:
        assert one.after_over_noise < 1.25
        assert one.rms_after < 1.25 * NOISE[one.channel]
    assert found.unseen.channels[0].rms_before > 5.0 * NOISE["force_N"]


@pytest.mark.nightly
def test_a_number_that_is_twenty_tolerances_off_is_found_and_called_unusual(place, built):
    """The data know it far better than its tolerance; a field solved with the true height gave the readings."""
    text = BASE.replace("length_mm = 0.03", "length_mm = 0.003").replace("= 500", f"= {TRUE_IRON}")
    (place / "tight.toml").write_text(text)
    readings(built, offset=0.0).to_csv(place / "tight.csv", index=False)
    options = {"numbers": HEIGHT, "effects": [], "workers": 1}
    result = ff.calibrate(place / "tight.toml", place / "tight.csv", place / "tight", **options)
    (height,) = result.numbers
    assert result.settled
    assert abs(height.value - TRUE_HEIGHT) < 4.0 * height.sd_as_drawn < 0.002  # of 0.07 mm
    assert "unusual" in str(result)


def test_a_number_of_the_drawing_is_the_same_in_every_run(found, bench):
    """What begins at a run is a magnet that was weakened, and no length."""
    observations = placed(found.model.without_effects, read_bench_table(bench))
    campaign = gather(observations, considered_effects((), observations.nominal))
    drawn = {effect.name for effect in observations.nominal.drawn}
    assert {HEIGHT, IRON} <= drawn & set(campaign.variants)
    assert "remanence" in campaign.in_some_runs
    assert not drawn & set(campaign.in_some_runs)


def test_the_drawing_that_is_written_has_the_field_of_the_device(found, place, built):
    """Solved afresh from the written text, with other meshes and between the swept distances: no slope is in it."""
    texts = {"new": found.drawing, "old": DRAWN, "true": TRUE}
    new, old, true = (field_of(text, place / name, "[4.5, 6.2, 9.7]") for name, text in texts.items())
    for name in ("force_N", "flux_linkage_Wb"):
        left, before = (np.sqrt(np.mean((one[name] - true[name]) ** 2)) for one in (new, old))
        assert left < 0.5 * NOISE[name]
        assert left < 0.05 * before


def test_the_result_is_a_drawing_with_its_comments_a_model_with_the_effect_and_data(found):
    assert "# by the caliper" in found.drawing
    changed = [new for old, new in zip(DRAWN.splitlines(), found.drawing.splitlines(), strict=True) if old != new]
    assert len(changed) == 2
    assert [one.effect.name for one in found.model.effects] == ["hall_offset"]
    assert found.model_as_drawn.effects == ()
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


def task(monkeypatch, cost, rise):
    """A calibration whose fields are replaced by a cost of one number, about steps to -1.5 of it, and its sweeps."""
    sweeps = []

    def swept(drawing, sweeps):
        return SimpleNamespace(drawing=drawing, sweeps=sweeps)

    def at(redrawn, choice, values):
        x = float(values[0])
        sweeps.append(x)
        facts = {"step": abs(10.0 * x), "fall": x * x, "cost": lambda _: cost(x)}
        return SimpleNamespace(redrawn=redrawn, choice=choice, values=values, change=-2.5 * values, **facts)

    monkeypatch.setattr(calibration, "RISE", rise)
    monkeypatch.setattr(calibration, "estimate", at)
    monkeypatch.setattr(calibration, "_moved", lambda _, now, part: ("drawing", now.change * (part - 0.4)))
    start = at(swept("drawing", 1), None, np.array([1.0]))
    return calibration._Task(None, None, swept, str).settled(start), sweeps


def test_a_step_that_makes_the_misfit_larger_is_taken_back_and_halved(monkeypatch):
    """Steps 2.5 times as long as they should be, as of a slope that is far too small: whole ones diverge."""
    now, _ = task(monkeypatch, lambda x: x * x, rise=0.0)
    assert now.step <= 0.1
    assert now.cost(now) <= 1e-4


def test_sweeps_end_where_meshes_differ_by_more_than_a_step_gains(monkeypatch):
    """The field solved anew is off by another ten each time, whatever the step."""
    scatter = iter(range(0, 1000, 10))
    now, sweeps = task(monkeypatch, lambda _: float(next(scatter)), rise=1.0)
    assert len(sweeps) == 4  # as drawn, two in vain, and the best one again
    assert now.step == 10.0 * abs(sweeps[0])
    assert sweeps[-1] == sweeps[0]


def test_turns_that_are_not_whole_are_said():
    (facts,) = Drawing(DRAWN, "small.toml", None).wanted("turns")
    one = CalibratedNumber.of(facts, 98.7, 0.7, 0.6)
    now = SimpleNamespace(choice=Choice((facts,)), covariance=np.array([[0.36]]))
    (remark,) = remarks(now, (one,), ())
    assert all(text in remark for text in (facts.title, "98.7", "99 is 0.43 ", "0.50 were the rest exactly as drawn"))
    assert not list(remarks(now, (replace(one, value=99.0),), ()))


@pytest.mark.nightly
def test_the_diagnosis_names_the_number_where_none_is_asked_for(place, built):
    """A lower magnet alone; it is written, and only then is nothing missing."""
    lower = BASE.replace("z_mm = [0, 4]", "z_mm = [0, 3.94]")
    readings(field_of(lower, place / "lower"), offset=0.0).to_csv(place / "lower.csv", index=False)
    result = ff.calibrate(place / "small.toml", place / "lower.csv", place / "runs", workers=1)
    by_key = {one.key: one for one in result.numbers}
    assert abs(by_key[HEIGHT].value - 3.94) < 3.0 * by_key[HEIGHT].sd
    assert result.lack_of_fit.p_value > 0.01


@pytest.mark.nightly
def test_a_pair_that_readings_cannot_separate_is_said(place):
    """The force alone, without current: a stronger magnet material is one of another recoil permeability."""
    rows = field_of(BASE, place / "clean")
    force = {"force_N": NOISE["force_N"]}
    readings(rows[rows["current_A"] == 0.0], noise=force).to_csv(place / "still.csv", index=False)
    pair = ["materials.hard.remanence_T", "materials.hard.relative_permeability"]
    result = ff.calibrate(
        place / "small.toml", place / "still.csv", place / "runs", numbers=pair, effects=(), workers=1
    )
    (combination,) = result.undetermined
    assert set(combination.change) == set(pair)
    assert 0.5 < combination.left <= 1.0


def test_errors_say_what_to_do_before_anything_is_solved(place, bench, tmp_path):
    for drawing, data, numbers, error, words in (
        ("small.toml", bench, "moving.magnet.height_mm", UsageError, re.escape(HEIGHT[:14])),
        ("small.toml", bench, (), UsageError, "number"),
        (GEOMETRY / "emaws-variants.toml", bench, None, ActuatorFileError, r"sweep\.parameters"),
        ("small.toml", [], HEIGHT, TableError, "measurement"),
    ):
        with pytest.raises(error, match=words):
            ff.calibrate(place / drawing, data, tmp_path / "runs", numbers=numbers)
    assert not (tmp_path / "runs").exists()


def test_standard_deviations_hold_what_was_not_fitted(found, place):
    """They are those of a fit of all suspects within their tolerances together, about readings as drawn."""
    drawing, model = Drawing(found.drawing, "small.toml", place), found.model.without_effects
    choice = Choice(drawing.wanted([HEIGHT, IRON]))
    whitening = whitening_beside(placed(model, read_bench_table(place / "bench.csv")))
    whitening = whitening.with_values(whitening.observations.base)
    here = Redrawn(drawing, found.table, model, whitening)
    now = estimate(here, choice, np.array([one.value for one in choice.numbers]))
    shown = [one for one in drawing.suspects if here.column(one) is not None]
    others = [one for one in shown if one not in choice.numbers and not one.is_contour]
    others = [one for one in others if not any(map(one.overlaps, choice.numbers))]
    off = whitening.full(np.stack([one.tolerance * here.column(one) for one in others], axis=1))
    columns = np.concatenate([now.fit.jacobian, off], axis=1)
    prior = np.concatenate([now.fit.precision, np.ones(len(others))])
    together = np.linalg.inv(columns.T @ columns + np.diag(prior))[:2, :2]
    np.testing.assert_allclose(now.error, now.scale @ together @ now.scale.T, rtol=1e-5)
    assert np.all(np.diag(now.error) > 10.0 * np.diag(now.covariance))


def test_the_error_of_turns_holds_what_the_wire_leaves_open_of_the_resistance(found, place):
    """A voltage cannot tell 2 % of the wire's cross-section from turns, and no file needs to give the resistance."""
    text = found.drawing.replace("resistance_ohm = 2", "wire_diameter_mm = 0.35")
    drawing, model = Drawing(text, "small.toml", place), found.model.without_effects
    read = pd.concat([pd.DataFrame({"run": run, "distance_m": 0.006, "current_A": [0.2, 0.4, 0.6]}) for run in (1, 2)])
    read["voltage_V"] = 1.02 * model.circuit.resistance_ohm * read["current_A"]
    read.to_csv(place / "voltages.csv", index=False)
    table = replace(read_bench_table(place / "voltages.csv"), declared_noise={"voltage_V": 1e-3})
    whitening = whitening_beside(placed(model, table))
    choice = Choice(drawing.wanted("coils.coil.turns"))
    now = estimate(Redrawn(drawing, found.table, model, whitening), choice, np.array([100.0]))
    assert 4.0 * np.sqrt(now.covariance[0, 0]) < now.change[0] < 2.0 * np.sqrt(now.error[0, 0])
    assert "coils.coil.resistance_ohm" not in {suspect.key for suspect in drawing.suspects}


def test_a_declared_tolerance_of_a_resistance_is_a_share_of_what_the_wire_has():
    text = SMALL.replace("resistance_ohm = 2", "wire_diameter_mm = 0.35")
    text = text.replace("[tolerances]", '[tolerances]\n"coils.coil.resistance_ohm" = 0.1')
    (resistance,) = [one for one in Drawing(text, "small.toml", Path()).uncertain if one.kind == "resistance"]
    (coil,) = actuator_from_toml(text).coils
    assert resistance.value == coil.resistance_ohm
    assert resistance.deviation == pytest.approx(0.1)


DRAWING = Drawing(SMALL, "small.toml", Path())
KNOWN = DRAWING.suspects
RADIUS = "moving.regions.magnet.r_mm[1]"


def number(key):
    (found,) = DRAWING.wanted(key)
    return found


def decision(*classes, **runs):
    """Named are these classes; effects act in runs that are counted from 0."""
    effects = [SimpleNamespace(effect=SimpleNamespace(name=names[0]), runs=runs.get(names[0])) for names in classes]
    return SimpleNamespace(classes=classes, fit=SimpleNamespace(effects=effects))


REMANENCE, MAGNET = "materials.hard.remanence_T", "magnet_temperature"


@pytest.mark.parametrize(
    ("classes", "numbers", "beside", "remarks"),
    [
        ([(HEIGHT,), ("hall_offset", "hall_gain")], [HEIGHT], {"hall_offset": (2, 3)}, {"hall_offset": "hall_gain"}),
        ([(HEIGHT, RADIUS)], [HEIGHT, RADIUS], {}, {HEIGHT: number(RADIUS).subject}),
        # The only magnet's remanence is a number of the drawing
        ([("remanence", "turns")], [REMANENCE, "coils.coil.turns"], {}, {REMANENCE: ""}),
        # Of a number and an effect the drawing's is calibrated, and how the other is checked is said
        ([(MAGNET, "remanence")], [REMANENCE], {}, {REMANENCE: effect_by_name(MAGNET).check}),
        ([("remanence", MAGNET)], [REMANENCE], {}, {REMANENCE: effect_by_name(MAGNET).check}),
        ([(HEIGHT, "coulomb_friction", RADIUS)], [HEIGHT, RADIUS], {}, {HEIGHT: "coulomb_friction"}),
    ],
)
def test_what_is_named_is_calibrated_with_the_effects_beside_it(classes, numbers, beside, remarks):
    choice = with_named(Choice(), decision(*classes, hall_offset=(1, 2)), KNOWN)
    assert [one.key for one in choice.numbers] == numbers
    assert choice.beside == beside
    assert set(choice.remarks) == set(remarks)
    assert all(words in choice.remarks[name] for name, words in remarks.items())
    if numbers == [REMANENCE, "coils.coil.turns"]:  # tolerances are standard deviations: 1.5 and 0.5 %
        assert [one.deviation for one in choice.numbers] == pytest.approx([0.018, 0.5])


def test_whoever_asks_for_a_number_decides_its_class():
    asked = Choice((number(RADIUS),))
    assert with_named(asked, decision(("coil_temperature", RADIUS)), KNOWN, asked=True) == asked
    choice = with_named(asked, decision((HEIGHT,), ("coulomb_friction",)), KNOWN, asked=True)
    assert (choice.numbers, choice.beside) == (asked.numbers, {"coulomb_friction": None})
    assert set(choice.remarks) == {HEIGHT}
    assert not with_named(choice, decision(), KNOWN, asked=True).remarks.get(HEIGHT)  # named no more


def test_nothing_is_calibrated_where_no_number_is_named(monkeypatch):
    monkeypatch.setattr(calibration, "said_of", lambda *_: "The verdict.")
    observations = SimpleNamespace(nominal=SimpleNamespace(drawn=()))
    changing = decision((HEIGHT,), **{HEIGHT: (1, 2)})
    for named, words in (
        (decision(), "The verdict"),
        (decision(("hall_offset",)), "hall_offset"),
        (changing, "run 2 to run 3"),
    ):
        with pytest.raises(TableError, match=words):
            _diagnosed(SimpleNamespace(**vars(named), observations=observations), KNOWN)


def test_a_number_is_called_by_its_key_path_a_unique_end_of_it_or_as_a_diagnosis_does():
    for key in ("materials.hard.remanence_T", "hard.remanence_T", "remanence_T", "remanence"):
        assert number(key).key == "materials.hard.remanence_T"
    assert number("magnet.z_mm[1]").key == HEIGHT
    both = DRAWING.wanted(["turns", "resistance"])
    assert [one.key for one in both] == ["coils.coil.turns", "coils.coil.resistance_ohm"]
    assert DRAWING.wanted("all") == KNOWN
    for one in KNOWN:
        assert {number(key) for key in (one.key, one.name, *one.also)} == {one}


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("z_mm[1]", r"coils\.coil\.z_mm\[1\]"),  # may be each of several
        ("hall_offset", "--with hall_offset"),
        ("mass_g", "depend"),
        ("moving.regions.magnet.z_mm[0]", "counts"),
        ("iron.remanence_T", "none"),
        ("iron.conductivity_MS_per_m", "depend"),
        ("moving.magnet.height_mm", r"Near it: .*moving\.regions\.magnet"),
    ],
)
def test_a_key_that_cannot_be_calibrated_is_refused_with_the_reason(key, words):
    with pytest.raises(UsageError, match=words):
        DRAWING.wanted(key)


POLE = "fixed.regions.frame.polygon_mm[8..10][1]"
CONE_END = "fixed.regions.frame.polygon_mm[10][1]"
DEEPER = -0.15


@pytest.fixture(scope="module")
def conical(tmp_path_factory):
    directory = tmp_path_factory.mktemp("conical")
    (directory / "conical.toml").write_text(CONICAL, encoding="utf-8")
    return directory


@pytest.fixture(scope="module")
def turned_bench(conical):
    """Readings of the device as it was built."""
    rows = field_of(at_distances(moved(DEEPER), "[0.5, 0.7, 1, 1.5, 2.2]"), conical / "built")
    noise = {"force_N": 0.02, "flux_linkage_Wb": 2e-4}
    readings(rows, seed=4, runs=2, noise=noise).to_csv(conical / "bench.csv", index=False)
    return conical / "bench.csv"


@pytest.fixture(scope="module")
def model(conical):
    """Fitted to the sweep of the drawing, which stands where ``femfit calibrate`` looks for it."""
    table = ff.run_sweep(conical / "conical.toml", conical / "runs" / "drawn", workers=1, signatures=True)
    ff.write_model(ff.fit_model(table).model, conical / "model.json")
    return conical / "model.json"


@pytest.mark.nightly
def test_a_deeper_pole_is_among_the_causes_of_readings_that_it_would_give(model, turned_bench):
    found = ff.diagnose(model, turned_bench)
    (missing,) = found.missing
    assert {"distance_offset", POLE} <= set(missing.members)
    assert not found.confident


@pytest.mark.nightly
def test_a_face_is_calibrated_by_its_name_and_written_with_all_its_corners(model, turned_bench, conical):
    done = femfit(
        "calibrate", conical / "conical.toml", turned_bench, "--numbers", "frame: face at z = 5 mm with its cone", "-o",
        conical / "new.toml", "--runs", conical / "runs", "--json", conical / "calibrated.json", "--workers", 1,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (number,) = json.loads((conical / "calibrated.json").read_text(encoding="utf-8"))["numbers"]
    assert number["key"] == POLE
    assert number["sd_as_drawn"] < 0.02
    assert abs(number["value"] - (5.0 + DEEPER)) < 2.0 * number["sd_as_drawn"]
    text = (conical / "new.toml").read_text(encoding="utf-8")
    corners = tomllib.loads(text)["fixed"]["regions"]["frame"]["polygon_mm"]
    change = round(number["value"] - 5.0, 9)
    assert [z for _, z in corners[8:]] == pytest.approx([5.0 + change, 5.0 + change, 0.1111 + change])
    assert corners[:8] == tomllib.loads(CONICAL)["fixed"]["regions"]["frame"]["polygon_mm"][:8]
    heading, _, drawing = text.partition("\n\n")
    assert all(line.startswith("#") for line in heading.splitlines())
    assert [line for line in drawing.splitlines() if "#" in line] == ["  # turned in one setting"]


@pytest.mark.nightly
def test_signatures_that_know_no_faces_are_still_read(model, conical, tmp_path):
    """As sweeps of before have them: by key paths alone."""
    older = shutil.copytree(conical / "runs" / "drawn", tmp_path / "older")
    data = json.loads((older / "signatures.json").read_text(encoding="utf-8"))
    fields = ("key", "also", "kind", "value", "unit", "tolerance", "effect")
    data["numbers"] = [{key: one[key] for key in fields} for one in data["numbers"] if ".." not in one["key"]]
    (older / "signatures.json").write_text(json.dumps(data), encoding="utf-8")
    fitted = ff.fit_model(ff.read_sweep(older)).model
    keys = {one.facts.key for one in numbers_from_toml(CONICAL) if not one.facts.effect and not one.facts.is_contour}
    assert keys >= {one.key for one in fitted.drawn} >= {CONE_END}


def test_noise_is_said_only_within_1_2_times_the_noise(found, bench):
    whitening = whitening_beside(placed(found.model, read_bench_table(bench)))
    still = replace(whitening, noise=replace(whitening.noise, mount_m=0.0, run=np.zeros(3)))
    for times, p_value, words in ((1.1, 1e-9, "not noise"), (1.19, 0.5, "(p"), (1.5, 0.5, "misses the")):
        rms = {name: times * sd for name, sd in still.noise.known.items()}
        assert words in verdict(still, LackOfFit(1.0, 10, p_value), rms)
