"""How parts conduct and store heat, and what surrounds an actuator, in SI units but degC."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from femfit.device.parts import Material

LORENZ_NUMBER = 2.44e-8
"""In V^2/K^2: a metal's thermal conductivity over its electrical one and its temperature (Wiedemann and Franz)."""

ROOM_K = 293.15


@dataclass(frozen=True)
class ThermalMaterial:
    """What is known of a material's heat; None where :func:`thermal_of` takes what is usual for its kind."""

    conductivity_W_per_m_K: float | None = None
    heat_capacity_J_per_m3_K: float | None = None
    working_temperature_C: float | None = None  # Largest, of a magnet; None where it is not known


UNKNOWN = ThermalMaterial()


@dataclass(frozen=True)
class Surroundings:
    """``[thermal]`` of an actuator file: what a drawing does not say of its heat."""

    ambient_C: float = 20.0
    # From a free face to still air, convection and radiation together (conventional: about 5 + 5)
    film_W_per_m2_K: float = 10.0
    # Air that is left where parts touch, and where a winding touches its core (assumed: 10 um between machined faces;
    # 0.1 mm, which conducts as well as 1 mm of former, for a winding on it)
    joint_m: float = 1e-5
    winding_joint_m: float = 1e-4
    # Between the strands (assumed: enamel and air; resin 0.25)
    insulation_W_per_m_K: float = 0.1
    # From the heaviest fixed part into what it is fastened to
    mounting_W_per_K: float = 0.0
    # Largest temperature of a winding; 130 degC is thermal class B of IEC 60085
    winding_limit_C: float = 130.0


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
