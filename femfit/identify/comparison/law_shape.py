"""The exported law has the wrong shape: a law against its own reference, before any measurement."""

from dataclasses import dataclass

import numpy as np

from femfit.core.amount import amount
from femfit.core.errors import DomainError
from femfit.identify.comparison.region import misfit_sentence
from femfit.model.actuator_model import ActuatorModel
from femfit.model.magnetics import LawMagnetics

_GRID = (40, 15)
_WRONG = 1.0
"""A law that misses its reference by more standard deviations of a reading (rms) has the wrong shape."""


@dataclass(frozen=True)
class ShapeMisfit:
    """How far a law is from what it was fitted to."""

    law: str
    # ``co-energy reference`` over the validity domain of the law, or the ``sweep`` of the law's own file
    against: str
    force_rms_N: float
    force_max_N: float
    over_noise: float | None  # The rms over the bench's noise floor of the force
    wrong: bool | None  # Whether that is more than one standard deviation of a reading; None without a noise floor
    sentence: str


def shape_misfit(model: ActuatorModel, reference: ActuatorModel | None, noise_N: float | None) -> ShapeMisfit | None:
    """Compare a law with its reference.

    Parameters
    ----------
    reference : ActuatorModel or None
        The co-energy of the same actuator; without it the misfit in the law's own file is taken.

    Returns
    -------
    ShapeMisfit or None
        None for a co-energy, and for a law whose file does not say its misfit.
    """
    base = model.without_effects
    if not isinstance(base.magnetics, LawMagnetics):
        return None
    place = ""
    if reference is not None:
        against, (rms, largest, place) = "co-energy reference", _over_the_box(base, reference)
    elif base.misfit is not None:
        against, rms, largest = base.misfit.against, base.misfit.force_rms_N, base.misfit.force_max_N
    else:
        return None
    name = base.magnetics.law_name
    ratio = None if noise_N is None else rms / noise_N
    text = f"{name} misses its {against} by {amount(rms, 'force_N')} rms, at most {amount(largest, 'force_N')}"
    text += "" if ratio is None else f": {ratio:.2g} times the noise of a force reading"
    wrong = None if ratio is None else ratio > _WRONG
    if wrong:
        text += ". The law has the wrong shape before any measurement; compare the co-energy reference instead"
    return ShapeMisfit(name, against, rms, largest, ratio, wrong, f"{text}.{' ' + place if place else ''}")


def _over_the_box(law: ActuatorModel, reference: ActuatorModel) -> tuple[float, float, str]:
    """Rms, maximum and where, over the part of the validity domain of the law that the reference has too."""
    a, b = law.validity, reference.without_effects.validity
    if not (
        max(a.distance_min_m, b.distance_min_m) <= min(a.distance_max_m, b.distance_max_m)
        and max(a.current_min_A, b.current_min_A) <= min(a.current_max_A, b.current_max_A)
    ):
        raise DomainError(
            f"The reference must cover distances and currents of the law; {reference.name!r} is valid in "
            f"{1e3 * b.distance_min_m:g}..{1e3 * b.distance_max_m:g} mm and {b.current_min_A:g}..{b.current_max_A:g} "
            f"A, the law in {1e3 * a.distance_min_m:g}..{1e3 * a.distance_max_m:g} mm and "
            f"{a.current_min_A:g}..{a.current_max_A:g} A. Give the co-energy of the same device."
        )
    d, i = (
        x.ravel()
        for x in np.meshgrid(
            np.linspace(max(a.distance_min_m, b.distance_min_m), min(a.distance_max_m, b.distance_max_m), _GRID[0]),
            np.linspace(max(a.current_min_A, b.current_min_A), min(a.current_max_A, b.current_max_A), _GRID[1]),
        )
    )
    truth = reference.without_effects.magnetics.force(d, i)
    error = law.magnetics.force(d, i) - truth
    sentence = misfit_sentence("The law's force", "force_N", error, error, truth, {"distance_m": d, "current_A": i})
    return float(np.sqrt(np.mean(error**2))), float(np.abs(error).max()), sentence
