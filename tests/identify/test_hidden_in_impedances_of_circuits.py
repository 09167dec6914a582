"""A number that differs from the drawing, hidden in the impedances of two windings that the field gave."""

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.core.errors import MissingPartError
from femfit.tables.impedance_table import NAME
from support.eddy_pot import IN_SERIES, TWO_WINDINGS

NOISE = 0.001  # of |Z|
GAPS_M = (0.001, 0.0015, 0.0025)
KEY, PERMEABILITY = "materials.iron.conductivity_MS_per_m", "materials.iron.relative_permeability"
CORE = "fixed.regions.pot.polygon_mm[5][0]"
EACH, MUTUAL, SHORTED = ("inner", "outer"), ("inner_outer",), ("inner_outer_shorted",)


def drawn(text, conductivity=5, permeability=200, core=5.0):
    text = text.replace("distance_mm = [1, 1.5, 2, 2.5]", "distance_mm = [1, 1.25, 1.5, 1.75, 2, 2.5]")
    text = text.replace("eddy_error = 0.02", "eddy_error = 0.002")  # so that 0.1 % of noise shows more than it hides
    text = text.replace("relative_permeability = 200", f"relative_permeability = {permeability}")
    text = text.replace("[5, -9], [5, 0]", f"[{core}, -9], [{core}, 0]")
    return text.replace("conductivity_MS_per_m = 5\n", f"conductivity_MS_per_m = {conductivity}\n")


def impedances(directory, text, **options):
    """What a sweep gives without bias at three gaps: settings, and complex ohm by the name in the column."""
    directory.with_suffix(".toml").write_text(text)
    ff.run_sweep(directory.with_suffix(".toml"), directory, workers=1, **options)
    rows = pd.read_csv(directory / NAME)
    currents = [name for name in rows if name.startswith("current_")]
    rows = rows[(rows[currents] == rows[currents].max()).all(axis=1) & rows["distance_m"].isin(GAPS_M)]
    names = [name.removeprefix("inductance").removesuffix("H") for name in rows if name.startswith("inductance")]
    w = 2.0 * np.pi * rows["frequency_Hz"].to_numpy()
    z = {of.strip("_"): (rows[f"resistance{of}ohm"] + 1j * w * rows[f"inductance{of}H"]).to_numpy() for of in names}
    return rows[["distance_m", "frequency_Hz"]], z


def measured(swept, path, names, seed):
    """Two runs of an impedance meter; beside a winding that is shorted it reads what is left of the admittance."""
    settings, z = swept
    z = z | {"inner_outer_shorted": z["inner"] - z["inner_outer"] ** 2 / z["outer"]}
    rng, runs = np.random.default_rng(seed), []
    for run in (1, 2):
        rows, w = settings.assign(run=run), 2.0 * np.pi * settings["frequency_Hz"].to_numpy()
        for name in names:
            error = NOISE * np.abs(z[name]) * (rng.normal(size=len(w)) + 1j * rng.normal(size=len(w)))
            rows[f"resistance_{name}_ohm"] = (z[name] + error).real
            rows[f"inductance_{name}_H"] = (z[name] + error).imag / w
        runs.append(rows)
    pd.concat(runs).to_csv(path, index=False)
    return path


@pytest.fixture(scope="module")
def as_drawn(tmp_path_factory):
    directory = tmp_path_factory.mktemp("drawn")
    swept = impedances(directory / "run", drawn(TWO_WINDINGS), signatures=True)
    return ff.fit_model(directory / "run").model, swept


@pytest.fixture(scope="module")
def as_built(tmp_path_factory):
    return impedances(tmp_path_factory.mktemp("built") / "run", drawn(TWO_WINDINGS, 4.4))


@pytest.mark.long
def test_the_windings_in_series_have_the_impedance_of_their_sum(as_drawn, tmp_path):
    """Z_1 + Z_2 + 2 Z_12 of one sweep is the impedance of another, of one circuit with both coils."""
    (_, z), (_, together) = as_drawn[1], impedances(tmp_path / "series", drawn(IN_SERIES))
    np.testing.assert_allclose(z["inner"] + z["outer"] + 2.0 * z["inner_outer"], together[""], rtol=1e-3)


@pytest.mark.long
def test_a_conductivity_is_named_with_its_size_from_any_of_them(as_drawn, as_built, tmp_path):
    model, _ = as_drawn
    for names in (EACH, MUTUAL, SHORTED, (*EACH, *MUTUAL)):
        path = measured(as_built, tmp_path / "z.csv", names, 3)
        found = ff.diagnose(model, path, rng=1, bootstrap=0)
        assert [KEY in one for one in found.decision.classes] == [True]
        (added,) = ff.add_effects(model, path, KEY).model.effects
        ((low, high),) = added.ci95.values()
        assert low < -0.12 < high < 0.0


@pytest.mark.long
def test_nothing_is_named_where_all_is_as_drawn(as_drawn, tmp_path):
    model, swept = as_drawn
    for names in (EACH, MUTUAL, SHORTED, (*EACH, *MUTUAL)):
        for seed in range(5):
            path = measured(swept, tmp_path / "z.csv", names, seed)
            assert not ff.diagnose(model, path, rng=1, bootstrap=0).missing


@pytest.mark.long
@pytest.mark.parametrize(
    ("key", "truth", "change"), [(PERMEABILITY, {"permeability": 170}, -0.15), (CORE, {"core": 5.15}, 0.15)]
)
def test_two_windings_tell_other_numbers_apart_too(as_drawn, tmp_path, key, truth, change):
    model, _ = as_drawn
    swept = impedances(tmp_path / "run", drawn(TWO_WINDINGS, **truth))
    path = measured(swept, tmp_path / "z.csv", (*EACH, *MUTUAL), 3)
    found = ff.diagnose(model, path, rng=1, bootstrap=0)
    assert [one.members for one in found.missing] == [(key,)]
    (value,) = found.missing[0].parameters.values()
    assert value == pytest.approx(change, rel=0.1)  # slopes are of first order
    with pytest.raises(MissingPartError, match="femfit calibrate"):  # its force would stay as drawn
        ff.add_effects(model, path, key)


@pytest.mark.long
def test_a_conductivity_is_calibrated(as_built, tmp_path):
    (tmp_path / "pot.toml").write_text(drawn(TWO_WINDINGS))
    path = measured(as_built, tmp_path / "z.csv", (*EACH, *MUTUAL), 3)
    result = ff.calibrate(tmp_path / "pot.toml", path, tmp_path / "run", numbers=[KEY])
    assert result.settled
    (number,) = result.numbers
    assert abs(number.value - 4.4) < 3.0 * number.sd
    assert number.sd < 0.5 * number.tolerance  # which includes that the other numbers are off within theirs
    assert number.sd_as_drawn < 0.01 * 4.4
