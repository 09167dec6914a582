"""One folder in which each command is run once, and a model file."""

import pytest

from femfit.model.json_file import write_model
from support.cli_case import Case, write_inputs


@pytest.fixture(scope="session")
def case(levitation_model, tmp_path_factory):
    """Inputs of every command; ``case.run(name)`` runs it once."""
    folder = tmp_path_factory.mktemp("case")
    write_inputs(levitation_model, folder)
    return Case(folder)


@pytest.fixture
def model_file(levitation_model, tmp_path):
    write_model(levitation_model, tmp_path / "model.json")
    return tmp_path / "model.json"
