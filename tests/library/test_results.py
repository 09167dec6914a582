"""What every public result has in common: it prints, shows in a notebook, copies, pickles and compares."""

import copy
import pickle
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest
from matplotlib import rc_context
from matplotlib.figure import Figure

import femfit as ff
from femfit.core.errors import UsageError
from femfit.core.results import Plotted
from femfit.device.load import actuator_from_toml
from femfit.identify.noise.whitening import Whitening
from femfit.report.figures import figures_of
from femfit.report.style import svg_uri
from support.actuators import GEOMETRY
from support.campaign import campaign, hidden
from support.page import Page
from support.replays import damped, logs
from support.small_drawing import SMALL
from support.small_records import coil_record, loop_record
from support.snapshot import check_snapshot


def unpickled(given):
    return pickle.loads(pickle.dumps(given))  # noqa: S301  made here


@pytest.fixture(scope="module")
def results(tmp_path_factory, levitation_model):
    """One of each public result, made as cheaply as possible."""
    place = tmp_path_factory.mktemp("results")
    d, i = (axis.ravel() for axis in np.meshgrid(np.linspace(0.015, 0.045, 10), np.linspace(0.0, 1.4, 5)))
    columns = {"current_A": i, "distance_m": d, "force_N": levitation_model.force(d, i)}
    columns["flux_linkage_Wb"] = levitation_model.flux_linkage(d, i)
    pd.DataFrame(columns).to_csv(place / "sweep.csv", index=False)
    table = ff.read_sweep(place / "sweep.csv")
    bench = campaign(levitation_model, 1, [hidden("hall_offset", offset_V=0.02)], runs=2, distances=5, currents=4)
    series = ff.read_measurement(loop_record(place / "loop.csv", 0.5, 2.0))
    found, added = ff.diagnose(levitation_model, bench), ff.add_effects(levitation_model, bench, "coil_temperature")
    others = [name for name in ff.list_effects() if name != "hall_offset"]
    return {
        "place": place,
        "actuator": ff.read_actuator(GEOMETRY / "emaws-rig.toml"),
        "sweep": table,
        "import": ff.import_table(place / "sweep.csv"),
        "fit": ff.fit_model(table, law="F1e"),
        "model": levitation_model,
        "model-with-effects": added.model,
        "bench-table": bench,
        "time-series": series,
        "comparison": ff.compare(levitation_model, bench),
        "diagnosis": found,
        "diagnosis-of-a-record": ff.diagnose(levitation_model, series, exclude=others),
        "advice": ff.suggest(levitation_model, bench, found),
        "added": added,
        "filter": ff.kalman_filter(levitation_model),
        "filter-under-effects": ff.kalman_filter(added.model, "ekf"),
        "observation": ff.observe(damped(), logs(300, 1, seed=8)[1][0], find=False),
        "sensing": ff.sense(levitation_model, sensors=("hall",), voltage_V=1.0, runs=2),
        "open-loop": ff.simulate(levitation_model, voltage_V=1.5, duration_s=0.002, start_m=0.022),
        "profile": ff.Profile("voltage", [0.0, 0.02], [12.0, 0.0]),
        "loop": ff.close_loop(levitation_model, runs=1, seconds=0.05),
        "coil-integral": ff.integrate_coil(coil_record(place / "coil.csv", 1.0), coil_area_m2=0.05),
        "export": ff.export(levitation_model, place / "build"),
    }


KINDS = [
    *("actuator", "sweep", "import", "fit", "model", "model-with-effects", "bench-table", "time-series", "comparison"),
    *("diagnosis", "diagnosis-of-a-record", "advice", "added", "filter", "filter-under-effects", "observation"),
    *("sensing", "open-loop", "profile", "loop", "coil-integral", "export"),
]


def test_every_kind_of_result_is_tested_and_what_can_be_drawn_has_its_figures_tested(results):
    assert set(results) == {*KINDS, "place"}
    assert {kind for kind, given in results.items() if isinstance(given, Plotted)} == set(FIGURES)


@pytest.mark.parametrize("kind", KINDS)
def test_a_result_prints_shows_copies_pickles_and_compares(kind, results, renew):
    given = results[kind]
    text = str(given)
    assert text.count("\n") < 60
    assert "\n" not in repr(given)
    assert len(repr(given)) < 400
    assert given._repr_html_().startswith("<pre>")
    for again in (unpickled(given), copy.deepcopy(given)):
        assert type(again) is type(given)
        assert (repr(again), str(again)) == (repr(given), text)
    assert given == given  # noqa: PLR0124  arrays would raise here
    assert given != copy.copy(given) or kind == "actuator"  # data without arrays are equal by value
    assert len({given, given}) == 1
    check_snapshot(f"result-{kind}", text.replace(str(results["place"]), "PLACE"), renew=renew)


CHANNELS = {"curves-force_N", "curves-flux_linkage_Wb", "curves-hall_V", "curves-voltage_V"}
FIGURES = {
    "actuator": {"actuator", "geometry", "mesh", "flux-lines", "flux-density"},
    **{kind: {"force-curves"} for kind in ("sweep", "import", "fit")},
    **{kind: {"stroke"} for kind in ("model", "model-with-effects")},
    **{kind: CHANNELS | {"misfit-maps"} for kind in ("comparison", "diagnosis")},
    "diagnosis-of-a-record": {"curves-force_balance_N", "curves-hall_V", "misfit-maps"},
    "added": CHANNELS,
    "observation": {"replay"},
    "sensing": {"sensing"},
    "open-loop": {"motion"},
    "loop": {"steps-backstepping"},
}


@pytest.mark.parametrize("kind", FIGURES)
def test_a_result_draws_what_its_names_say(kind, results, monkeypatch):
    monkeypatch.setattr("femfit.report.figures.solve_point", pytest.fail)  # what shows no field solves none
    given = results[kind]
    assert set(figures_of(given)) == FIGURES[kind]
    with pytest.raises(UsageError, match=next(iter(figures_of(given)))):
        given.plot("picture")
    drawn = given.plot()
    assert isinstance(drawn, Figure)
    assert drawn.axes
    assert drawn._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize("kind", ["sweep", "fit", "model", "comparison", "diagnosis", "added"])
def test_a_page_has_the_pictures_that_a_result_draws(kind, results, tmp_path):
    given = results[kind]
    page = Page(ff.write_report(given, tmp_path / "page.html").read_text(encoding="utf-8"))
    for name in figures_of(given):
        assert page.images[name]["src"] == svg_uri(partial(given.plot, name), name), name


def test_a_figure_looks_the_same_whatever_the_users_settings_are(results):
    with rc_context({"xtick.color": "red", "axes.grid": False, "font.size": 20.0}):
        other = results["model"].plot("stroke")._repr_png_()
    assert other == results["model"].plot("stroke")._repr_png_()


def test_a_drawing_shows_its_field_where_femfit_view_does(results):
    figure = actuator_from_toml(SMALL).plot("flux-lines")
    assert figure.axes[0].get_title(loc="left").startswith("small: flux lines\nd = 8 mm, i = 1 A, F = ")
    with pytest.raises(UsageError, match="nothing to draw of <ActuatorModel: pair"):
        replace(results["model"], name="pair", circuits=()).plot()


def test_a_pickled_diagnosis_holds_no_working_of_its_search(results):
    """Factors of the noise's covariance can be worked out again; what no refit goes on with has no use any more."""
    found = results["diagnosis"]
    whitening = found.campaign.whitening
    fresh = Whitening(whitening.observations, whitening.noise, whitening.misfit)
    whitening.full(whitening.observations.residual)
    assert len(pickle.dumps(whitening)) == len(pickle.dumps(fresh))
    again = unpickled(whitening)
    one, other = (each.full(each.observations.residual) for each in (again, whitening))
    np.testing.assert_array_equal(one, other)
    basis, columns = found.campaign.patterns.groups[0][0], found.campaign.unknown.columns
    campaign = unpickled(found.campaign)
    assert not {"patterns", "unknown", "variants"} & set(vars(campaign))
    np.testing.assert_array_equal(campaign.patterns.groups[0][0], basis)
    np.testing.assert_array_equal(campaign.unknown.columns, columns)
    assert found.fits


def test_what_comes_back_predicts_steps_and_explains_as_before(results):
    model = results["model-with-effects"]
    assert model.force(0.02, 0.5) == copy.deepcopy(model).force(0.02, 0.5)
    ukf = results["filter"]
    ukf.step(ukf.start([0.022, 0.0, 0.4]), 1.1, 2.7)  # one that was used
    states = [one.step(one.start([0.022, 0.0, 0.4]), 1.1, 2.7).mean for one in (ukf, unpickled(ukf))]
    assert np.array_equal(*states)
    found = results["diagnosis"]
    explained = [one.observations.predict(results["added"].added) for one in (found, unpickled(found))]
    assert np.array_equal(*explained)


def test_an_effect_of_the_catalogue_stays_the_one_that_it_is():
    for effect in ff.list_effects().values():
        assert unpickled(effect) is effect
        assert copy.deepcopy(effect) is effect
