"""The tables of materials; as in :mod:`femfit.device.schema`."""

from typing import Annotated

from pydantic import Field

from femfit.device.schema import Entry


class ConductorEntry(Entry):
    """How a material of either kind conducts."""

    conductivity_MS_per_m: float = Field(
        0.0,
        ge=0,
        le=1e4,
        description="Give the electrical conductivity in MS/m (10^6 S/m): copper 58, mild steel 5 to 9, 0 for what "
        "does not conduct.",
    )
    lamination_mm: float = Field(
        0.0,
        ge=0,
        le=100,
        description="Give the thickness in mm of insulated sheets that stand radially around the axis, so that no "
        "current flows around it; 0 for a solid part and for discs.",
    )
    thermal_conductivity_W_per_m_K: float | None = Field(
        None, gt=0, le=5e3, description="Give the thermal conductivity, or leave it to what is usual for its kind."
    )
    heat_capacity_MJ_per_m3_K: float | None = Field(
        None,
        gt=0,
        le=100,
        description="Give density times specific heat (steel 3.4, aluminium 2.4), or leave it to what is usual.",
    )


class MaterialEntry(ConductorEntry):
    """``[materials.NAME]``: a linear material."""

    relative_permeability: float = Field(
        ge=1e-6, le=1e7, description="Give mu_r, 1 for everything non-magnetic; the recoil permeability of a magnet."
    )
    remanence_T: float = Field(
        0.0, ge=0, le=3, description="Give B_r in tesla (1 T = 10 kG); the direction is the region's magnetization."
    )
    remanence_coefficient_per_K: float = Field(
        0.0, ge=-0.02, le=0.02, description="Give the relative change of B_r per kelvin: -0.0012 for -0.12 %/K."
    )
    working_temperature_C: float | None = Field(
        None, ge=-273, le=1000, description="Give a magnet's largest working temperature in degC, where it is known."
    )


CurveValues = Annotated[list[float], Field(max_length=1000)]


class CurveEntry(ConductorEntry):
    """``[materials.NAME]``: a soft material with a magnetisation curve, from a file or from two lists."""

    bh_curve: str | None = Field(
        None, min_length=1, description="Give a steel of the library, or a CSV file with the columns B_T,H_A_per_m."
    )
    B_T: CurveValues | None = Field(None, description="Give ascending flux densities in tesla as a list, from 0.")
    H_A_per_m: CurveValues | None = Field(None, description="Give ascending fields in A/m as a list, from 0.")


CURVE_KEYS = CurveEntry.model_fields.keys() - ConductorEntry.model_fields.keys()


def has_curve(table: object) -> bool:
    """Whether a table of a material gives a magnetisation curve."""
    return isinstance(table, dict) and bool(table.keys() & CURVE_KEYS)
