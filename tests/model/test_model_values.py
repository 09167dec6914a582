"""What a user asks a model for: force, flux linkage, inductance, and what it is made of."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import DomainError
from femfit.device.load import read_actuator
from femfit.device.summary import sweep_manifest_entry
from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.model.json_file import model_from_dict, model_to_dict
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.model.validity import ActuatorKind
from femfit.model.with_effects import nominal_of, with_effects
from support.actuators import GEOMETRY

KIND = ActuatorKind(False, True, True, False, True, False)


@pytest.mark.parametrize("quantity", ["force", "flux_linkage", "inductance"])
def test_a_model_is_evaluated_at_numbers_and_arrays(levitation_model, quantity):
    d, i = np.linspace(0.016, 0.04, 5), np.linspace(0.1, 1.3, 5)
    values = getattr(levitation_model, quantity)(d, i)
    np.testing.assert_array_equal(values, getattr(levitation_model.magnetics, quantity)(d, i))
    assert float(getattr(levitation_model, quantity)(d[2], i[2])) == values[2]


@pytest.mark.parametrize("quantity", ["force", "flux_linkage", "inductance"])
@pytest.mark.parametrize(("distance", "current"), [(7.0, 1.0), (0.02, 20.0), (float("nan"), 1.0)])
def test_a_model_refuses_points_outside_of_its_validity_domain(levitation_model, quantity, distance, current):
    with pytest.raises(DomainError, match=r"15\.\.45 mm and 0\.\.1\.4 A"):
        getattr(levitation_model, quantity)(distance, current)
    if np.isfinite(distance):
        assert np.isfinite(getattr(levitation_model, quantity)(distance, current, extrapolate=True))


@pytest.mark.parametrize("extrapolate", [False, True])
def test_distances_and_currents_that_do_not_broadcast_are_refused_with_their_shapes(levitation_model, extrapolate):
    with pytest.raises(DomainError, match=r"\(2,\) and shape \(3,\)"):
        levitation_model.force([0.02, 0.03], [0.1, 0.2, 0.3], extrapolate=extrapolate)
    with pytest.raises(DomainError, match="no such array"):
        levitation_model.force("far", 0.2, extrapolate=extrapolate)


def test_a_model_without_its_effects_is_the_one_that_was_fitted(levitation_model):
    added = with_effects(levitation_model, [AddedEffect(effect_by_name("constant_force"), {"pull_N": 1e-3})])
    assert added.without_effects is levitation_model
    assert levitation_model.without_effects is levitation_model


def test_the_drawing_decides_whether_there_is_a_magnet(levitation_model):
    assert levitation_model.has_magnet  # no drawing: force remains without current
    no_magnet = replace(levitation_model, kind=replace(KIND, moving_magnet=False))
    assert not no_magnet.has_magnet
    assert not nominal_of(no_magnet).has_magnet
    steel = replace(
        levitation_model, magnetics=LawMagnetics("F1e", (Coefficient("d^-2", 2, 1e-6, ""),), {}, 0.016, 0.0)
    )
    assert not steel.has_magnet
    assert nominal_of(replace(steel, kind=KIND)).has_magnet


def test_whether_there_is_a_magnet_is_unknown_without_a_drawing_and_without_zero_current(levitation_model):
    energised = replace(levitation_model, validity=replace(levitation_model.validity, current_min_A=0.25))
    assert not energised.magnet_known
    assert not nominal_of(energised).has_magnet
    assert replace(energised, kind=KIND).magnet_known
    assert nominal_of(replace(energised, kind=KIND)).has_magnet
    assert levitation_model.magnet_known


def test_the_kind_of_actuator_survives_the_file(levitation_model):
    again = model_from_dict(model_to_dict(replace(levitation_model, kind=KIND)))
    assert again.kind == KIND
    assert model_from_dict({**model_to_dict(levitation_model), "kind": None}).kind is None


@pytest.mark.parametrize(
    ("file", "kind"),
    [
        ("emaws.toml", ActuatorKind(False, True, True, False, True, False)),
        ("plunger-solenoid.toml", ActuatorKind(False, False, True, True, True, False)),
        ("emaws-saturable.toml", ActuatorKind(False, True, True, False, True, True)),
    ],
)
def test_a_drawing_says_what_kind_of_actuator_it_is(file, kind):
    assert ActuatorKind(**sweep_manifest_entry(read_actuator(str(GEOMETRY / file)))["kind"]) == kind
