"""What kind of part a region is, with its colour in all pictures."""

from femfit.device.parts import Actuator, Material, NonlinearMaterial

IRON_FROM = 1.5
"""Relative permeability from which a material without remanence is drawn as iron; magnets recoil with 1.05."""

COLOURS = {
    "iron, fixed": "#8c96a1",
    "iron, moving": "#5b6f86",
    "magnet": "#b0477d",
    "winding": "#e0a341",
    "not magnetic": "#dfe3e7",
}
"""Distinct in lightness as well as in hue."""

HALL_COLOUR = "#009e73"


def kind_of(material: Material, moving: bool) -> str:
    """The kind of a region."""
    if material.remanence_T:
        return "magnet"
    if material.relative_permeability >= IRON_FROM:
        return "iron, moving" if moving else "iron, fixed"
    return "not magnetic"


def has_magnet(actuator: Actuator) -> bool:
    """Whether any part has a remanence."""
    return any(region.material.remanence_T for region in (*actuator.fixed, *actuator.moving.regions))


def saturates(actuator: Actuator) -> bool:
    """Whether any part has a B-H curve."""
    regions = (*actuator.fixed, *actuator.moving.regions)
    return any(isinstance(region.material, NonlinearMaterial) for region in regions)
