"""What a model says of itself: the words stand in ``templates/model.j2``."""

from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.core.words import lines_of, templates_of
from femfit.model.network_magnetics import FORMULA, NETWORK

if TYPE_CHECKING:
    from femfit.model.actuator_model import ActuatorModel


def sentence(macro: str, *facts: Any) -> str:
    """The lines that a macro of the template makes of facts."""
    return "\n".join(lines_of(str(getattr(_environment().get_template("model.j2").module, macro)(*facts))))


@cache
def _environment() -> Any:
    environment = templates_of("femfit.model")
    environment.globals |= {"NETWORK": NETWORK, "FORMULA": FORMULA, "eddy_times": eddy_times, "zip": zip}
    return environment


def eddy_times(model: "ActuatorModel") -> FloatArray:
    """Time constants in s of the eddy currents' states over the distances, while nothing changes the circuits'."""
    windings, n = model.windings, len(model.circuits)
    d = np.linspace(model.validity.distance_min_m, model.validity.distance_max_m, 9)
    own = windings.magnetics.inductance(d, np.zeros((9, windings.count)))[:, n:, n:]
    root = np.sqrt(windings.resistances_ohm[n:])
    return np.asarray(np.linalg.eigvalsh(own / (root[:, None] * root)))
