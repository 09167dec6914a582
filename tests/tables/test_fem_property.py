"""A FEMM drawing in other units, upside down or shifted is the same actuator."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from femfit.tables.femm.model import FemOptions
from femfit.tables.femm.read import import_fem
from support.fem_files import UNIT_MM, suspension

NANOMETRE = 1e-9


def imported(text):
    return import_fem(text.encode(), "model.fem", FemOptions()).actuator


def parts(actuator):
    return (*actuator.fixed, *actuator.moving.regions, *actuator.coils)


@settings(max_examples=15, deadline=None)
@given(unit=st.sampled_from(sorted(UNIT_MM)), below=st.booleans(), face=st.sampled_from([0.0, -37.25, 12.5]))
def test_a_drawing_in_other_units_upside_down_or_shifted_is_the_same_actuator(unit, below, face):
    expected, actuator = imported(suspension()), imported(suspension(unit, below=below, face=face))
    assert actuator.sweep == expected.sweep
    for part, same in zip(parts(actuator), parts(expected), strict=True):
        np.testing.assert_allclose(sorted(part.vertices_m), sorted(same.vertices_m), atol=NANOMETRE)
        # a mirror at a plane z = const leaves axial moments and currents as they are
        assert getattr(part, "material", None) == getattr(same, "material", None)
