"""Numbers that differ from the drawing, hidden in impedances of one and two windings that the field gave."""

from itertools import product

import numpy as np
import pandas as pd
import pytest

import femfit as ff
from femfit.tables.eddy_table import IMPEDANCES
from support.small_drawing import POT, TWO_WINDINGS

pytestmark = pytest.mark.nightly

NOISE = 0.001  # of |Z|
GAPS_M = (0.001, 0.0015, 0.0025)
PERMEABILITY, CONDUCTIVITY = "materials.iron.relative_permeability", "materials.iron.conductivity_MS_per_m"
EACH, MUTUAL, SHORTED = ("inner", "outer"), ("inner_outer",), ("inner_outer_shorted",)
READ = {"one": [("",)], "two": [EACH, MUTUAL, SHORTED, (*EACH, *MUTUAL)]}
DRAWINGS = {"one": POT, "two": TWO_WINDINGS}


def impedances(directory, text, conductivity=5, permeability=200, **options):
    """What the sweep of a drawing gives at one bias and three gaps: settings, and complex ohm by the column's name."""
    for old, new in (
        ("distance_mm = [1, 1.5, 2, 2.5]", "distance_mm = [1, 1.25, 1.5, 1.75, 2, 2.5]"),
        ("eddy_error = 0.02", "eddy_error = 0.002"),  # so that 0.1 % of noise shows more than it hides
        ("relative_permeability = 200", f"relative_permeability = {permeability}"),
        ("conductivity_MS_per_m = 5\n", f"conductivity_MS_per_m = {conductivity}\n"),
    ):
        text = text.replace(old, new)
    drawing = directory.with_suffix(".toml")
    drawing.write_text(text)
    ff.run_sweep(drawing, directory, workers=1, **options)
    rows = pd.read_csv(directory / IMPEDANCES)
    currents = [name for name in rows if name.startswith("current_")]
    bias = rows[currents].max() if len(currents) > 1 else 0.0
    rows = rows[(rows[currents] == bias).all(axis=1) & rows["distance_m"].isin(GAPS_M)]
    names = [name.removeprefix("inductance").removesuffix("H") for name in rows if name.startswith("inductance")]
    w = 2.0 * np.pi * rows["frequency_Hz"].to_numpy()
    z = {of.strip("_"): (rows[f"resistance{of}ohm"] + 1j * w * rows[f"inductance{of}H"]).to_numpy() for of in names}
    return rows[["distance_m", "frequency_Hz"]], z


def measured(swept, path, names, seed):
    """Two runs of an impedance meter; beside a winding that is shorted it reads what is left of the admittance."""
    settings, z = swept
    if "outer" in z:
        z = z | {"inner_outer_shorted": z["inner"] - z["inner_outer"] ** 2 / z["outer"]}
    rng, runs = np.random.default_rng(seed), []
    for run in (1, 2):
        rows, w = settings.assign(run=run), 2.0 * np.pi * settings["frequency_Hz"].to_numpy()
        for name in names:
            error = NOISE * np.abs(z[name]) * (rng.normal(size=len(w)) + 1j * rng.normal(size=len(w)))
            of = f"_{name}_" if name else "_"
            rows[f"resistance{of}ohm"], rows[f"inductance{of}H"] = (z[name] + error).real, (z[name] + error).imag / w
        runs.append(rows)
    pd.concat(runs).to_csv(path, index=False)
    return path


@pytest.fixture(scope="module")
def as_drawn(tmp_path_factory):
    """Of one winding and of two: the drawing, its model, and what its own sweep gave."""
    directory, found = tmp_path_factory.mktemp("drawn"), {}
    for windings, text in DRAWINGS.items():
        swept = impedances(directory / windings, text, signatures=True)
        found[windings] = directory / f"{windings}.toml", ff.fit_model(directory / windings).model, swept
    return found


@pytest.mark.parametrize("windings", READ)
def test_nothing_is_named_where_all_is_as_drawn(as_drawn, tmp_path, windings):
    _, model, swept = as_drawn[windings]
    for seed, names in product(range(5), READ[windings]):
        assert not ff.diagnose(model, measured(swept, tmp_path / "z.csv", names, seed)).missing


@pytest.mark.parametrize(
    ("windings", "truth", "keys"),
    [
        ("one", {"permeability": 170, "conductivity": 6}, (CONDUCTIVITY, PERMEABILITY)),
        ("two", {"conductivity": 4.4}, (CONDUCTIVITY,)),
        ("two", {"permeability": 170}, (PERMEABILITY,)),
    ],
)
def test_numbers_of_a_material_are_named_with_their_size_and_calibrated_together(
    as_drawn, tmp_path, windings, truth, keys
):
    drawing, model, _ = as_drawn[windings]
    swept = impedances(tmp_path / "built", DRAWINGS[windings], **truth)
    path = measured(swept, tmp_path / "z.csv", READ[windings][-1], 3)
    found = ff.diagnose(model, path)
    assert len(found.classes) == len(keys)
    assert all(any(key in one for one in found.classes) for key in keys)
    if windings == "two":  # alone, with the size that the field was solved with; slopes are of first order
        (value,) = found.missing[0].parameters.values()
        assert value == pytest.approx({CONDUCTIVITY: -0.12, PERMEABILITY: -0.15}[keys[0]], rel=0.1)
    result = ff.calibrate(drawing, path, tmp_path / "run", numbers=list(keys))
    assert result.settled
    for number in result.numbers:
        true = truth["conductivity" if number.key == CONDUCTIVITY else "permeability"]
        assert abs(number.value - true) < 3.0 * number.sd
        assert number.sd_as_drawn < 0.05 * true
    if keys == (CONDUCTIVITY,):
        assert number.sd < 0.5 * number.tolerance  # which includes that the other numbers are off within theirs
        assert number.sd_as_drawn < 0.01 * true
