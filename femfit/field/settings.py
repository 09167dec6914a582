"""Settings of the field solver, with the defaults that the validation was made with."""

from dataclasses import dataclass

from femfit.device.parts import Actuator
from femfit.field.newton import TOLERANCE


@dataclass(frozen=True)
class SolverSettings:
    """How fine the field is solved."""

    order: int = 5  # Polynomial order of the unknown; the error estimate uses ``order - 1`` on the same mesh
    # Element size at the corners of iron and magnets, as a fraction of the part's smallest extent. Fields are
    # singular there, and this sets the accuracy.
    corner_fraction: float = 0.03
    region_fraction: float = 0.45  # Largest element size within a part, as a fraction of its smallest extent
    grading: float = 0.5  # How fast elements grow, Netgen's convention: 0 uniform, 1 fastest
    # Radius of the domain over the largest distance of any part from the origin. The boundary carries the exact
    # condition of a dipole field, so what is left falls with the fifth power of this factor.
    outer_radius_factor: float = 16.0
    stretch_limit: float = 1.8  # Largest ratio of distances that one mesh is stretched over before a new one is made
    newton_tolerance: float = TOLERANCE  # Relative size of the last correction of a saturating part's field
    # Relative accuracy of force and flux linkage; order and element sizes are then chosen to meet it, those above are
    # not used (:mod:`femfit.field.tolerance`)
    tolerance: float | None = None
    # Highest frequency whose skin depth the elements in conducting parts resolve; 0 for static fields alone
    skin_frequency_Hz: float = 0.0


def settings_for(actuator: Actuator) -> SolverSettings:
    """The defaults, with the actuator's own tolerance."""
    return SolverSettings(tolerance=actuator.tolerance)
