"""What programs read of results."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from femfit.core.results import Result, json_ready


@dataclass(frozen=True)
class Fit:
    order: int
    errors: np.ndarray


@dataclass(frozen=True)
class Force(Result):
    data = "force_N=value", "order=fit.order", "fit", "limits"

    value: float
    fit: Fit | None = None

    @property
    def limits(self):
        return {"file": Path("a/b"), "range": (0, np.inf)}


def test_a_path_to_what_a_result_lacks_is_none_and_a_record_without_data_is_read_by_its_fields():
    limits = {"file": "a/b", "range": [0, np.inf]}
    assert Force(2.0).to_dict() == {"force_N": 2.0, "order": None, "fit": None, "limits": limits}
    fit = Fit(3, np.array([0.5]))
    assert Force(2.0, fit).to_dict()["order"] == 3
    assert json_ready([Force(2.0, fit)])[0]["fit"] == {"order": 3, "errors": [0.5]}


def test_what_is_not_finite_is_null_in_files():
    assert json_ready(Force(np.nan, Fit(1, np.array([np.nan]))))["fit"]["errors"] == [None]
    assert json_ready({"force": Force(np.nan)})["force"]["limits"] == {"file": "a/b", "range": [0, None]}
