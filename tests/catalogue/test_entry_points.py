"""Laws and effects of other packages come in by entry points, and only when they are asked for."""

import sys
from dataclasses import replace
from importlib.metadata import EntryPoint
from types import ModuleType, SimpleNamespace

import pytest

from femfit.core.errors import ModelFileError, UsageError
from femfit.effects import catalogue as effects
from femfit.effects.zeros_and_scales import HALL_OFFSET
from femfit.laws import catalogue as laws
from femfit.laws.dipoles import F1E

CATALOGUES = {
    "law": SimpleNamespace(
        module=laws, by_name=laws.law_by_name, every=laws.all_laws, ours=F1E, impostor={"formula": "an impostor's"}
    ),
    "effect": SimpleNamespace(
        module=effects,
        by_name=effects.effect_by_name,
        every=effects.all_effects,
        ours=HALL_OFFSET,
        impostor={"symptom": "An impostor's."},
    ),
}


@pytest.fixture(params=CATALOGUES)
def catalogue(request, monkeypatch):
    """A catalogue, and another package with an entry of its own and one that pretends to be femfit's."""
    found, package = CATALOGUES[request.param], ModuleType("third_party")
    package.THEIRS, package.IMPOSTOR = replace(found.ours, name="theirs"), replace(found.ours, **found.impostor)
    monkeypatch.setitem(sys.modules, "third_party", package)

    def install(**entries):
        points = [EntryPoint(name, value, found.module.GROUP) for name, value in entries.items()]

        def entry_points(group, name=None):
            return [p for p in points if p.group == group and name in {None, p.name}]

        monkeypatch.setattr(found.module, "entry_points", entry_points)

    return SimpleNamespace(**vars(found), package=package, install=install)


def test_an_entry_of_another_package_is_found_by_its_name(catalogue):
    catalogue.install(theirs="third_party:THEIRS")
    assert catalogue.by_name("theirs") is catalogue.package.THEIRS
    assert catalogue.every()["theirs"] is catalogue.package.THEIRS


def test_a_name_of_femfits_own_cannot_be_taken(catalogue):
    catalogue.install(**{catalogue.ours.name: "third_party:IMPOSTOR"})
    assert catalogue.by_name(catalogue.ours.name) is catalogue.ours
    assert catalogue.every()[catalogue.ours.name] is catalogue.ours


@pytest.mark.parametrize("value", ["absent_package:X", "third_party:ABSENT", "third_party:IMPOSTOR"])
def test_a_broken_package_is_named_when_its_entry_is_asked_for_and_not_before(catalogue, value):
    catalogue.install(broken=value)
    assert catalogue.by_name(catalogue.ours.name) is catalogue.ours
    with pytest.raises(ModelFileError, match="'broken'"):
        catalogue.by_name("broken")


def test_an_unknown_law_lists_all_known_ones(monkeypatch):
    theirs = EntryPoint("theirs", "third_party:THEIRS", laws.GROUP)
    monkeypatch.setattr(laws, "entry_points", lambda group, name=None: [theirs] * (name in {None, "theirs"}))
    monkeypatch.setitem(sys.modules, "third_party", SimpleNamespace(THEIRS=replace(F1E, name="theirs")))
    with pytest.raises(UsageError, match=r"F1e.*theirs; instead received 'F9'"):
        laws.law_by_name("F9")
