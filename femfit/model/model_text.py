"""What a model says of itself: the words stand in ``templates/model.j2``."""

from typing import TYPE_CHECKING

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.results import Words
from femfit.model.several_magnetics import FORMULA, NETWORK

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel


def eddy_times(model: "ActuatorModel") -> FloatArray:
    """Time constants in s of the eddy currents' states over the distances, while nothing changes the circuits'."""
    windings, n = model.windings, len(model.circuits)
    d = np.linspace(model.validity.distance_min_m, model.validity.distance_max_m, 9)
    own = windings.magnetics.inductance(d, np.zeros((9, windings.count)))[:, n:, n:]
    root = np.sqrt(windings.resistances_ohm[n:])
    return np.asarray(np.linalg.eigvalsh(own / (root[:, None] * root)))


sentence = Words("femfit.model", names={"NETWORK": NETWORK, "FORMULA": FORMULA, "eddy_times": eddy_times}).sentence
