"""How parts conduct and store heat, and what surrounds an actuator, in SI units but degC."""

from dataclasses import replace
from typing import TYPE_CHECKING

from femfit.device.keys import Record, key

if TYPE_CHECKING:
    from femfit.device.parts import Material

LORENZ_NUMBER = 2.44e-8
"""In V^2/K^2: a metal's thermal conductivity over its electrical one and its temperature (Wiedemann and Franz)."""

ROOM_K = 293.15


class ThermalMaterial(Record, kw_only=False):
    """What is known of a material's heat; None where :func:`thermal_of` takes what is usual for its kind."""

    conductivity_W_per_m_K: float | None = key(
        "the thermal conductivity, or leave it to its kind", None, file="thermal_conductivity_W_per_m_K", gt=0, le=5e3
    )
    heat_capacity_J_per_m3_K: float | None = key(
        "density times specific heat (steel 3.4, aluminium 2.4), or leave it to what is usual", None, gt=0, le=100
    )
    working_temperature_C: float | None = key(
        "a magnet's largest working temperature in degC, where it is known", None, ge=-273, le=1000
    )


UNKNOWN = ThermalMaterial()


class Surroundings(Record, kw_only=False):
    """``[thermal]`` of an actuator file: what a drawing does not say of its heat."""

    ambient_C: float = key("the temperature around the actuator", 20.0, ge=-200, le=500)
    # Convection and radiation together (conventional: about 5 + 5)
    film_W_per_m2_K: float = key(
        "what a free face gives off for each kelvin with radiation: 5 to 15 in still air, 20 to 100 with a fan",
        10.0,
        gt=0,
        le=1e5,
    )
    # Assumed: 10 um between machined faces; 0.1 mm, which conducts as well as 1 mm of former, for a winding on it
    joint_m: float = key("the air that is left where two parts touch; a press fit 0.005", 1e-5, ge=1e-4, le=10)
    winding_joint_m: float = key("the same between a winding and what it is drawn to touch", 1e-4, ge=1e-4, le=10)
    # Assumed: enamel and air
    insulation_W_per_m_K: float = key(
        "the thermal conductivity between a winding's strands: 0.1 dry, 0.25 in resin", 0.1, gt=0, le=100
    )
    mounting_W_per_K: float = key(
        "what the heaviest fixed part conducts into what it is fastened to, for each kelvin", 0.0, ge=0, le=1e6
    )
    # 130 degC is thermal class B of IEC 60085
    winding_limit_C: float = key(
        "a winding's largest temperature: 105, 120, 130, 155, 180 for the classes A, E, B, F, H",
        130.0,
        ge=-200,
        le=1000,
    )


STILL_AIR = Surroundings()

AIR_CONDUCTIVITY = 0.027
"""In W/(m K), at about 40 degC (Incropera and DeWitt, Fundamentals of Heat and Mass Transfer, table A.4)."""

MAGNET = ThermalMaterial(8.0, 3.5e6)
METAL_CAPACITY = 3.4e6
CERAMIC = ThermalMaterial(4.0, 3.6e6)
PLASTIC = ThermalMaterial(0.25, 2.0e6)
"""Usual values of the kinds: sintered NdFeB 7.5 g/cm^3; copper 3.44e6 and steel 3.40e6 J/(m^3 K) (Incropera and DeWitt,
table A.1); soft ferrite 4.8 g/cm^3, 700 to 800 J/(kg K), 3.5 to 5 W/(m K) (Ferroxcube, Soft Ferrites and Accessories);
technical plastics 0.2 to 0.35 W/(m K)."""


def thermal_of(material: "Material") -> ThermalMaterial:
    """What a material is taken to have where its table does not say: by remanence, conductivity or permeability."""
    if material.remanence_T:
        usual = MAGNET
    elif material.conductivity_S_per_m:
        usual = ThermalMaterial(LORENZ_NUMBER * ROOM_K * material.conductivity_S_per_m, METAL_CAPACITY)
    else:
        usual = CERAMIC if material.relative_permeability > 1.0 else PLASTIC
    values = {name: value for name, value in vars(material.thermal).items() if value is not None}
    return replace(usual, **values)
