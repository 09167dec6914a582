"""Filters of thousands of samples."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def compiled_steps():
    """Thousands of samples by few filters: here a compiler pays."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("FEMFIT_COMPILER", raising=False)
        yield
