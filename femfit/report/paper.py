"""What the paper printed, for its own geometry.

References
----------
A. Chowdhury and A. Sarjas, Sensors 16 (2016) 1504: Table 4 and the ratios of Table 6.
"""

from femfit.device.parts import Actuator

CITATION = "A. Chowdhury and A. Sarjaš, Sensors 16 (2016) 1504"

NAMES = ("emaws", "emaws-rig")
"""Actuator files that draw the paper's geometry: with its 30 turns, and with the turns that explain its constants."""

TURNS = 30
A_N_M4 = 5.996e-9
M_N_M2_PER_A = 4.509e-6
"""Table 4: F = a d^-4 + m i d^-2."""


def is_papers(actuator: Actuator) -> bool:
    """Whether an actuator is the paper's."""
    return actuator.name in NAMES
