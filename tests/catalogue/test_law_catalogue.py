"""Laws of other packages come in by entry points, and only when they are asked for."""

import sys
from dataclasses import replace
from importlib.metadata import EntryPoint
from types import ModuleType

import pytest

from femfit.core.errors import ModelFileError, UsageError
from femfit.laws import catalogue
from femfit.laws.dipoles import F1E

THEIRS = replace(F1E, name="theirs")
IMPOSTOR = replace(F1E, formula="an impostor's")


@pytest.fixture
def installed(monkeypatch):
    """Pretend that other packages are installed."""

    def install(**entries):
        points = [EntryPoint(name, value, catalogue.GROUP) for name, value in entries.items()]

        def entry_points(group, name=None):
            return [p for p in points if p.group == group and name in {None, p.name}]

        monkeypatch.setattr(catalogue, "entry_points", entry_points)

    return install


@pytest.fixture(autouse=True)
def third_party(monkeypatch):
    module = ModuleType("third_party_laws")
    module.THEIRS, module.IMPOSTOR = THEIRS, IMPOSTOR
    monkeypatch.setitem(sys.modules, "third_party_laws", module)


def test_a_law_of_another_package_is_found_by_its_name(installed):
    installed(theirs="third_party_laws:THEIRS")
    assert catalogue.law_by_name("theirs") is THEIRS
    assert catalogue.all_laws()["theirs"] is THEIRS


def test_a_name_of_femfits_own_cannot_be_taken(installed):
    installed(F1e="third_party_laws:IMPOSTOR")
    assert catalogue.law_by_name("F1e") is F1E
    assert catalogue.all_laws()["F1e"] is F1E


@pytest.mark.parametrize("value", ["absent_package:LAW", "third_party_laws:ABSENT"])
def test_a_broken_package_is_named_when_its_law_is_asked_for_and_not_before(installed, value):
    installed(broken=value)
    assert catalogue.law_by_name("F1e") is F1E
    with pytest.raises(ModelFileError, match=r"'broken' .* cannot be loaded"):
        catalogue.law_by_name("broken")


def test_an_entry_point_must_be_called_as_its_law(installed):
    installed(alias="third_party_laws:THEIRS")
    with pytest.raises(ModelFileError, match=r"'alias'.*must give a ForceLaw of that name"):
        catalogue.law_by_name("alias")


def test_an_unknown_law_lists_all_known_ones(installed):
    installed(theirs="third_party_laws:THEIRS")
    with pytest.raises(UsageError, match=r"F1e.*theirs; instead received 'F9'"):
        catalogue.law_by_name("F9")
