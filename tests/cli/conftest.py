"""One folder in which each command is run once."""

import pytest

from support.cli_case import Case, write_inputs


@pytest.fixture(scope="session")
def case(levitation_model, tmp_path_factory):
    """Inputs of every command; ``case.run(name)`` runs it once."""
    folder = tmp_path_factory.mktemp("case")
    write_inputs(levitation_model, folder)
    return Case(folder)
