"""What a user asks a model for: force, flux linkage, inductance, and what it is made of."""

from dataclasses import replace

import numpy as np
import pytest

from femfit.core.errors import DomainError
from femfit.device.load import read_actuator, sweep_manifest_entry
from femfit.model.magnetics import Coefficient, LawMagnetics
from femfit.model.validity import ActuatorKind, ValidityBox
from femfit.model.with_effects import nominal_of
from support.actuators import GEOMETRY
from support.one_current import flat, within

KIND = ActuatorKind(False, True, True, False, True, False)
BOX = ValidityBox.of_currents((0.015, 0.045), (0.0, 1.4))


@pytest.mark.parametrize("quantity", ["force", "flux_linkage", "inductance"])
def test_a_model_is_evaluated_at_numbers_and_arrays_of_its_validity_domain(levitation_model, quantity):
    evaluate = getattr(levitation_model, quantity)
    d, i = np.linspace(0.016, 0.04, 5), np.linspace(0.1, 1.3, 5)
    np.testing.assert_array_equal(evaluate(d, i), getattr(flat(levitation_model.magnetics), quantity)(d, i))
    assert float(evaluate(d[2], i[2])) == evaluate(d, i)[2]
    for distance, current in ((7.0, 1.0), (0.02, 20.0), (float("nan"), 1.0)):
        with pytest.raises(DomainError, match=r"15\.\.45 mm and 0\.\.1\.4 A"):
            evaluate(distance, current)
        assert not np.isfinite(distance) or np.isfinite(evaluate(distance, current, extrapolate=True))


def test_the_validity_box_holds_its_edges_and_no_nan_and_spans_a_grid_of_all_currents():
    rows = [
        (0.015, 0.0, True), (0.045, 1.4, True), (0.015 - 1e-12, 0.0, True), (0.0149, 0.5, False), (0.0451, 0.5, False),
        (0.02, -0.01, False), (0.02, 1.41, False), (np.nan, 0.5, False), (0.02, np.nan, False), (np.inf, 0.5, False),
    ]  # fmt: skip
    distance, current, inside = np.array(rows).T
    assert BOX.contains(distance, current[:, None]).tolist() == inside.astype(bool).tolist()
    BOX.require(np.array([0.02, 0.03]), np.array([0.5]))
    with pytest.raises(DomainError, match=r"15\.\.45 mm and 0\.\.1\.4 A.*received 60 mm and 0\.5 A"):
        BOX.require(np.array([0.02, 0.06]), np.array([0.5]))
    with pytest.raises(DomainError, match="received nan mm"):
        BOX.require(np.asarray(np.nan), np.array([0.5]))
    d, i = ValidityBox.of_currents((1e-3, 2e-3), (0.0, 1.0), (-1.0, 1.0)).grid(2, 3)
    assert (d.shape, i.shape) == ((18,), (18, 2))
    assert {tuple(row) for row in i.tolist()} == {(a, b) for a in (0.0, 0.5, 1.0) for b in (-1.0, 0.0, 1.0)}
    assert ValidityBox.of_currents((1e-3, 2e-3), (0.0, 1.0)).grid(2, 3)[1].shape == (6, 1)


def test_the_drawing_or_a_force_without_current_decides_whether_there_is_a_magnet(levitation_model):
    law = LawMagnetics("F1e", (Coefficient("d^-2", 2, 1e-6, ""),), {}, 0.016, 0.0)
    steel = replace(levitation_model, magnetics=law)
    energised = replace(levitation_model, validity=within(levitation_model.validity, low=0.25))
    for model, has_magnet, is_known in (
        (levitation_model, True, True),
        (replace(levitation_model, kind=replace(KIND, moving_magnet=False)), False, True),
        (steel, False, True),
        (replace(steel, kind=KIND), True, True),
        (energised, False, False),
        (replace(energised, kind=KIND), True, True),
    ):
        assert nominal_of(model).has_magnet is has_magnet
        assert model.magnet_known is is_known
    assert levitation_model.has_magnet


@pytest.mark.parametrize(
    ("file", "kind"),
    [
        ("emaws.toml", KIND),
        ("plunger-solenoid.toml", ActuatorKind(False, False, True, True, True, False)),
        ("emaws-saturable.toml", replace(KIND, saturates=True)),
    ],
)
def test_a_drawing_says_what_kind_of_actuator_it_is(file, kind):
    assert ActuatorKind(**sweep_manifest_entry(read_actuator(str(GEOMETRY / file)))["kind"]) == kind
