"""What a real actuator may have that its drawing does not: the same drawing with one thing changed.

Each function returns a drawing of which the field is solved anew; nothing here is an approximation of a field.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from femfit.core.errors import MissingPartError
from femfit.core.numerics import MU_0, FloatArray
from femfit.device.parts import Actuator, LinearMaterial, Material, NonlinearMaterial, Region

_IRON_PERMEABILITY = 600.0
"""Tells iron from ferrite."""


def is_magnet(region: Region) -> bool:
    """Whether a region has a remanence."""
    return region.material.remanence_T != 0.0


def is_soft(region: Region) -> bool:
    """Whether a region is iron or ferrite."""
    return not is_magnet(region) and region.material.relative_permeability > 10.0


def is_linear_iron(region: Region) -> bool:
    """Whether a region is iron or ferrite that is drawn without a B-H curve."""
    return is_soft(region) and isinstance(region.material, LinearMaterial)


def has_magnet(actuator: Actuator) -> bool:
    """Whether any part is a permanent magnet."""
    return any(map(is_magnet, actuator.regions))


def scaled_magnets(actuator: Actuator, change: float) -> Actuator:
    """Every magnet with 1 + change times its remanence."""

    def scaled(region: Region) -> Material:
        if not isinstance(region.material, LinearMaterial):
            raise MissingPartError(
                f"{region.name} must be a magnet to be scaled; its material is {region.material.name}."
            )
        return replace(region.material, remanence_T=(1.0 + change) * region.material.remanence_T)

    return _with_materials(actuator, scaled, is_magnet)


def saturable_core(actuator: Actuator, polarisation: float) -> Actuator:
    """Every soft part that is drawn without a curve with one that starts at its permeability and saturates.

    B = mu_0 H + chi mu_0 H / (1 + chi mu_0 H / J_s), the law of Froehlich and Kennelly.

    Parameters
    ----------
    polarisation : float
        J_s of ferrite in T; iron has four times as much.

    References
    ----------
    R. M. Bozorth, Ferromagnetism (Van Nostrand, 1951), chapter 11.
    """
    return with_curve(actuator, lambda x: x / (1.0 + x), polarisation)


def with_curve(actuator: Actuator, law: Callable[[FloatArray], FloatArray], polarisation: float) -> Actuator:
    """Every soft part that is drawn without a curve with J = J_s law(chi mu_0 H / J_s); law(x) rises as x to 1."""

    def curve(region: Region) -> Material:
        largest = polarisation * (4.0 if region.material.relative_permeability > _IRON_PERMEABILITY else 1.0)
        x = np.concatenate([[0.0], np.geomspace(0.02, 60.0, 48)])
        h = x * largest / (MU_0 * (region.material.relative_permeability - 1.0))
        b = MU_0 * h + largest * law(x)
        return NonlinearMaterial("saturable", tuple(b.tolist()), tuple(h.tolist()))

    return _with_materials(actuator, curve, is_linear_iron)


def _with_materials(
    actuator: Actuator, change: Callable[[Region], Material], where: Callable[[Region], bool]
) -> Actuator:
    def changed(regions: tuple[Region, ...]) -> tuple[Region, ...]:
        return tuple(replace(region, material=change(region)) if where(region) else region for region in regions)

    moving = replace(actuator.moving, regions=changed(actuator.moving.regions))
    return replace(actuator, fixed=changed(actuator.fixed), moving=moving)
