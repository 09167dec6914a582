"""What a field solution leaves open of a drawing: the magnet's strength, the winding's turns and its resistance.

They are effects of their own, and may be fitted beside another one, held near their nulls by a prior, so that this does
not have to mop up a base that is slightly off.
"""

from femfit.effects.remanence import REMANENCE
from femfit.effects.resistance import RESISTANCE
from femfit.effects.turns import TURNS

TOLERANCES = (REMANENCE, TURNS, RESISTANCE)

TOLERANCE_SD = 0.02
"""Standard deviation of each of them beside another effect, before anything is measured.

Remanence within a grade some 3 % either way (IEC 60404-8-1), resistance of round wire some 3 % (IEC 60317-0-1).
"""
