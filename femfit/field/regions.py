"""Names of the mesh's regions, and patterns that select them.

A part with a material is ``fixed:NAME`` or ``moving:NAME``, a coil ``fixed_coil:NAME`` or ``moving_coil:NAME``; around
the moving part lie ``halo`` and ``layer``, and ``air`` is all the rest.
"""

from femfit.device.parts import Coil

MOVING = "moving(_coil)?:.*"
FIXED = "fixed(_coil)?:.*"

AIR = "air|halo|layer|(fixed|moving)_coil:.*"
"""All regions without a material."""


def coil_region(coil: Coil) -> str:
    """Name of a coil's region."""
    return f"{'moving' if coil.moves else 'fixed'}_coil:{coil.name}"
