"""What a bench table tells of the path that the current took."""

import numpy as np
import pandas as pd
import pytest

from femfit.identify.readings.bench import conditions_of
from femfit.model.with_effects import nominal_of


def covariates(current, branch, run=1.0, distance=0.02):
    n = len(current)
    flat = np.ones(n)
    return pd.DataFrame(
        {
            "run": run * flat,
            "mount": flat,
            "distance_m": distance * flat,
            "current_A": current,
            "branch": branch,
            "coil_temperature_C": np.nan * flat,
            "magnet_temperature_C": np.nan * flat,
            "order": np.arange(float(n)),
            "elapsed": np.arange(float(n)),
        }
    )


CURRENT = np.array([0.2, 0.6, 1.0, 1.4, 1.0, 0.6, 0.2])
BRANCH = np.array([1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0])


@pytest.fixture
def nominal(levitation_model):
    return nominal_of(levitation_model)


def test_rows_in_the_order_of_measuring_tell_the_path(nominal):
    recalled = conditions_of(covariates(CURRENT, BRANCH), nominal).recalled
    virgin = recalled["hysteresis_medium_virgin"]
    assert virgin[1] > 0.0 > virgin[-1]
    # The same current on the way up and on the way down
    assert virgin[2] > virgin[4]


def test_rows_sorted_by_current_do_not(nominal):
    by_current = np.argsort(CURRENT, kind="stable")
    table = covariates(CURRENT[by_current], BRANCH[by_current])
    assert not conditions_of(table, nominal).recalled


def test_the_path_is_told_row_by_row_wherever_the_rows_stand(nominal):
    whole = covariates(CURRENT, BRANCH)
    order = np.array([3, 0, 6, 2, 5, 1, 4])
    mixed = whole.iloc[order].reset_index(drop=True)
    there, here = (conditions_of(table, nominal).recalled for table in (whole, mixed))
    for name, values in there.items():
        np.testing.assert_array_equal(here[name], values[order])


def test_an_ammeter_that_trembles_moves_no_wall(nominal):
    trembling = np.repeat(CURRENT, 2) + np.tile([0.0, 1e-3], 7)
    quiet = conditions_of(covariates(np.repeat(CURRENT, 2), np.repeat(BRANCH, 2)), nominal).recalled
    seen = conditions_of(covariates(trembling, np.repeat(BRANCH, 2)), nominal).recalled
    for name, values in quiet.items():
        np.testing.assert_allclose(seen[name], values, atol=1e-12)
