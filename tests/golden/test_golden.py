"""What users get is what they got: renewed by tests/golden/renew.py, which says what changed."""

import pytest

from golden import freeze
from golden.cases import CASES, LONG


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.nightly] if name in LONG else []) for name in CASES]
)
def test_results_are_those_that_are_stored(name):
    found = [one for one in freeze.differences(freeze.read(name), freeze.frozen(CASES[name]())) if one[1] > 1.0]
    assert not found
