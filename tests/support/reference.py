"""Where the reference data lie, which are not part of the project."""

from pathlib import Path

import pytest

REFERENCE = Path(__file__).parents[2].parent / "shared" / "reference"

needs_reference = pytest.mark.skipif(not REFERENCE.is_dir(), reason="the reference data are not part of the project")
