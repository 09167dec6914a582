"""Every law of the catalogue against one reference row, its own derivatives and its own cost."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import quad

import femfit.laws
from femfit.laws.catalogue import BUILT_IN
from femfit.laws.law import LONGEST_M, ForceLaw

ROWS = pd.read_csv(Path(__file__).with_name("reference_rows.csv"), comment="#", keep_default_na=False)
ROWS = ROWS.set_index("law")
DISTANCES = np.geomspace(1e-3, 0.2, 40)


def shape_of(law):
    text = ROWS.loc[law.name, "shape"]
    return {name: float(value) for name, value in (pair.split("=") for pair in text.split(";") if pair)}


def decays(law):
    columns = law.columns(DISTANCES, shape_of(law))
    return np.all(columns[-1] < columns[0])


every_law = pytest.mark.parametrize("law", BUILT_IN, ids=lambda law: law.name)


def test_every_file_of_the_room_is_in_the_catalogue_and_has_a_reference_row():
    files = {path.stem for path in Path(femfit.laws.__file__).parent.glob("*.py")}
    files -= {"__init__", "law", "catalogue"}
    declared = [value for file in files for value in vars(import_module(f"femfit.laws.{file}")).values()]
    assert {law.name for law in declared if isinstance(law, ForceLaw)} == {law.name for law in BUILT_IN}
    assert len(BUILT_IN) == len({law.name for law in BUILT_IN}) >= 8
    assert set(ROWS.index) == {law.name for law in BUILT_IN}


@every_law
def test_columns_reproduce_the_reference_row(law):
    row = ROWS.loc[law.name]
    expected = [float(value) for value in row["columns"].split(";")]
    computed = law.columns(np.array([row["distance_m"]]), shape_of(law))[0]
    # A handful of roundings of 1.1e-16 each.
    np.testing.assert_allclose(computed, expected, rtol=3e-15)


@every_law
def test_declarations_agree_with_the_columns(law):
    shape = {p.name: p.start for p in law.shape}
    for function in (law.columns, law.potential_columns):
        assert function(DISTANCES, shape).shape == (len(DISTANCES), len(law.basis))
    assert len(law.coefficient_units) == len(law.basis) == len(set(law.basis))
    assert law.nonnegative in {(), (True,) * len(law.basis)}
    assert law.reference
    assert law.formula
    for p in law.shape:
        assert 0 < p.lower < p.start < LONGEST_M
        assert p.name.endswith("_m")
        assert p.description
    assert set(shape_of(law)) == set(shape)


@every_law
def test_potential_is_the_integral_of_the_columns_to_infinity(law):
    shape = shape_of(law)
    near, far = 0.01, 0.05
    for k in range(len(law.basis)):
        integral = quad(lambda d, k=k: law.columns(np.array([d]), shape)[0, k], near, far, epsabs=0, epsrel=1e-11)[0]
        difference = law.potential_columns(np.array([near]), shape) - law.potential_columns(np.array([far]), shape)
        # Tolerance: the quadrature's.
        assert difference[0, k] == pytest.approx(integral, rel=1e-9)
    if not decays(law):
        assert np.all(law.potential_columns(np.array([0.0]), shape) == 0.0)
        return
    at_infinity = law.potential_columns(np.array([1e6]), shape)
    assert np.all(np.abs(at_infinity) < 1e-6 * law.potential_columns(np.array([near]), shape))


@every_law
def test_columns_attract_and_decay_or_pass_the_face(law):
    assert np.all(law.columns(DISTANCES, shape_of(law)) > 0)
    assert decays(law) or law.passes_face


@every_law
def test_laws_that_pass_the_face_are_smooth_there_and_no_others(law):
    with np.errstate(divide="ignore", invalid="ignore"):
        columns = law.columns(np.linspace(-0.02, 0.02, 81), shape_of(law))
        jumps = np.abs(np.diff(columns, axis=0)).max(axis=0) / np.abs(columns).max(axis=0)
    assert bool(np.all(jumps < 0.5)) == law.passes_face  # of steps of 0.5 mm; NaN counts as a jump


@every_law
def test_unit_of_each_coefficient_makes_a_newton(law):
    # Lengths scaled by 2 scale a column of unit m^-n by 2^-n: its coefficient's unit must say n.
    shape = shape_of(law)
    doubled = {name: 2.0 * value for name, value in shape.items()}
    ratio = law.columns(DISTANCES, shape) / law.columns(2.0 * DISTANCES, doubled)
    powers = np.log2(ratio)
    for k, unit in enumerate(law.coefficient_units):
        n = 0 if unit == "N" else int(unit.removeprefix("N m^"))
        np.testing.assert_allclose(powers[:, k], n, atol=1e-9)


@every_law
def test_operations_with_affine_functions_stay_below_sixty(law):
    assert law.operations_with([(0, 1)] * len(law.basis)) == ROWS.loc[law.name, "operations"] <= 60
