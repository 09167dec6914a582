"""The exported law has the wrong shape: a law against the table it was fitted to, before any measurement."""

from dataclasses import dataclass

from femfit.core.amount import amount
from femfit.identify.constants import WRONG_SHAPE
from femfit.model.actuator_model import ActuatorModel
from femfit.model.magnetics import LawMagnetics


@dataclass(frozen=True)
class ShapeMisfit:
    """How far a law is from what it was fitted to."""

    law: str
    against: str  # What the law's file says that it was fitted to: ``sweep``
    force_rms_N: float
    force_max_N: float
    over_noise: float | None  # The rms over the bench's noise floor of the force
    wrong: bool | None  # Whether that is more than one standard deviation of a reading; None without a noise floor
    sentence: str


def shape_misfit(model: ActuatorModel, noise_N: float | None) -> ShapeMisfit | None:
    """Compare a law with its table; None for a co-energy, and for a law whose file does not say its misfit."""
    base = model.without_effects
    misfit = base.misfit
    if not isinstance(base.magnetics, LawMagnetics) or misfit is None:
        return None
    name, rms, largest = base.magnetics.law_name, misfit.force_rms_N, misfit.force_max_N
    ratio = None if noise_N is None else rms / noise_N
    text = f"{name} misses its {misfit.against} by {amount(rms, 'force_N')} rms, at most {amount(largest, 'force_N')}"
    text += "" if ratio is None else f": {ratio:.2g} times the noise of a force reading"
    wrong = None if ratio is None else ratio > WRONG_SHAPE
    if wrong:
        text += ". The law has the wrong shape before any measurement; compare the co-energy reference instead"
    return ShapeMisfit(name, misfit.against, rms, largest, ratio, wrong, f"{text}.")
