"""The table ``[thermal]``; as in :mod:`femfit.device.schema`, with the defaults of :mod:`femfit.device.thermal`."""

from pydantic import Field

from femfit.device.schema import Entry
from femfit.device.thermal import STILL_AIR as USUAL


class ThermalEntry(Entry):
    """``[thermal]``: what temperatures depend on beside the drawing."""

    ambient_C: float = Field(USUAL.ambient_C, ge=-200, le=500, description="Give the temperature around the actuator.")
    film_W_per_m2_K: float = Field(
        USUAL.film_W_per_m2_K,
        gt=0,
        le=1e5,
        description="Give what a free face gives off for each kelvin: 5 to 15 in still air with radiation, 20 to 100 "
        "with a fan.",
    )
    joint_mm: float = Field(
        0.01, ge=1e-4, le=10, description="Give the air that is left where two parts touch; a press fit 0.005."
    )
    winding_joint_mm: float = Field(
        0.1, ge=1e-4, le=10, description="Give the same between a winding and what it is drawn to touch."
    )
    insulation_W_per_m_K: float = Field(
        USUAL.insulation_W_per_m_K,
        gt=0,
        le=100,
        description="Give the thermal conductivity between a winding's strands: 0.1 dry, 0.25 in resin.",
    )
    mounting_W_per_K: float = Field(
        USUAL.mounting_W_per_K,
        ge=0,
        le=1e6,
        description="Give what the heaviest fixed part conducts into what it is fastened to, for each kelvin.",
    )
    winding_limit_C: float = Field(
        USUAL.winding_limit_C,
        ge=-200,
        le=1000,
        description="Give the largest temperature of a winding: 105, 120, 130, 155, 180 for the classes A, E, B, F, H.",
    )
