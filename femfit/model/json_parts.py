"""Mechanics and drive in a model file: keys of a later version are optional, and written where they say something.

Sensors beside the Hall element in a model file.

Eddy currents in a model file.

Fields at sensors in a model file: of one current as before there were several, else of any currents.
"""

from dataclasses import MISSING, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from femfit.device.electrics import AccelerationSensor, CurrentSensor, ForceSensor, PositionSensor
from femfit.device.mechanics import Mechanics
from femfit.model.bspline import LINE
from femfit.model.eddy_currents import EddyBias, EddyCurrents, EddyError
from femfit.model.hall import HallField, HallSpline, OtherSensor, PickupSensor, SensedField
from femfit.model.json_magnetics import (
    COORDINATE_KEYS,
    coordinate_from,
    coordinate_to,
    knots_from,
    nested_from,
    nested_to,
    spline_from,
)
from femfit.model.json_section import Section

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


ALWAYS = ("mass_kg", "gravity_m_s2", "kind", "unit")
"""Keys that are written even where they have their usual value."""


def unusual(value: "DataclassInstance") -> dict[str, object]:
    """The fields that differ from their defaults, and those of :data:`ALWAYS`."""
    return {
        f.name: getattr(value, f.name)
        for f in fields(value)
        if f.name in ALWAYS or f.default is MISSING or getattr(value, f.name) != f.default
    }


def mechanics_from(section: Section) -> Mechanics:
    """Mass and gravity, and what a file may say beside them."""
    mechanics = section.record(Mechanics)
    if not mechanics.ends[0] < mechanics.ends[1]:
        raise section.refusal("far_stop", "at a larger distance than near_stop")
    return mechanics


def sensed_to(field: SensedField) -> dict[str, Any]:
    """A field of any currents as JSON-ready data."""
    return nested_to(field, "currents")


def hall_field_from(section: Section) -> HallField:
    """The field at a Hall element, of one current or of any."""
    return sensed_from(section) if "currents" in section.data else HallSpline(*spline_from(section, LINE))


def sensed_from(section: Section) -> SensedField:
    """A field of any currents."""
    along = section.sections("currents") if section.data.get("currents") != [] else ()
    return SensedField(*nested_from(section, "currents", along, least_degree=1))


KINDS: dict[str, type[OtherSensor]] = {
    "current": CurrentSensor,
    "position": PositionSensor,
    "pickup_coil": PickupSensor,
    "acceleration": AccelerationSensor,
    "force": ForceSensor,
}


def sensors_from(
    sections: tuple[Section, ...],
) -> tuple[OtherSensor, ...]:
    """Sensors of every kind but Hall elements, whose names differ."""
    found = tuple(_sensor_from(section) for section in sections)
    names = [sensor.name for sensor in found]
    for section, name in zip(sections, names, strict=True):
        if names.count(name) > 1 or name == "hall":
            raise section.refusal("name", "a name of its own, and not hall")
    return found


def _sensor_from(section: Section) -> OtherSensor:
    kind = section.text("kind")
    if kind not in KINDS:
        raise section.refusal("kind", f"one of {', '.join(KINDS)}")
    flux: dict[str, Any] = {"flux": sensed_from(section.section("flux"))} if kind == "pickup_coil" else {}
    return section.record(KINDS[kind], **flux)


_ARRAYS = ("resistances_ohm", "u_knots", "couplings", "flux_linkages_Wb", "inductances_H", "hall_T_per_A")


def eddy_to(eddy: EddyCurrents) -> dict[str, Any]:
    """The patterns as JSON-ready data."""
    arrays = {name: getattr(eddy, name) for name in _ARRAYS}
    return {
        "names": eddy.names,
        "circuits": eddy.circuits,
        **coordinate_to(eddy.coordinate),
        "u_degree": eddy.u_degree,
        **{name: one for name, one in arrays.items() if one is not None},
        "error": eddy.error,
        **({} if eddy.bias is None else {"bias": eddy.bias}),
    }


def _bias_from(section: Section, circuits: int) -> EddyBias:
    section.refuse_others(("distances_m", "current_A", "materials"))
    distances = section.array("distances_m", 1)
    if not len(distances) or not (np.diff(distances) > 0.0).all():
        raise section.refusal("distances_m", "numbers that grow")
    return EddyBias(distances, section.shaped("current_A", (len(distances), circuits)), section.names("materials"))


def eddy_from(section: Section, circuits: tuple[str, ...]) -> EddyCurrents:
    """The patterns of a model with these circuits."""
    section.refuse_others(("names", "circuits", *COORDINATE_KEYS, "u_degree", *_ARRAYS, "error", "bias"))
    names, of = (section.names(key) for key in ("names", "circuits"))
    if circuits and of != circuits:
        raise section.refusal("circuits", f"those of the model ({', '.join(circuits)}), in their order")
    if len({*names, *of, ""}) <= len(names) + len(of):
        raise section.refusal("names", "names that differ from each other and from the circuits'")
    knots, degree = knots_from(section, "u_knots", section.integer("u_degree", 2, 9))
    r, functions = len(names), len(knots) - degree - 1
    resistances = section.array("resistances_ohm", 1)
    if not r or len(resistances) != r or not np.all(resistances > 0.0):
        raise section.refusal("resistances_ohm", "as many numbers > 0 as there are names, and one at least")
    error, bias = (section.optional_section(key) for key in ("error", "bias"))
    found = EddyCurrents(
        names=names,
        resistances_ohm=resistances,
        circuits=of,
        coordinate=coordinate_from(section),
        u_knots=knots,
        u_degree=degree,
        couplings=section.shaped("couplings", (functions, len(of), r)) if of else np.zeros((functions, 0, r)),
        flux_linkages_Wb=section.shaped("flux_linkages_Wb", (functions, r)),
        inductances_H=section.shaped("inductances_H", (functions, r * (r + 1) // 2)),
        hall_T_per_A=section.shaped("hall_T_per_A", (functions, r)) if "hall_T_per_A" in section.data else None,
        error=error.record(EddyError) if error else None,
        bias=_bias_from(bias, len(of)) if bias else None,
    )
    least = np.linalg.eigvalsh(found.forms(found.coordinate.distance(np.unique(knots)))[0].inductance).min()
    if not least > 0.0:
        raise section.refusal("inductances_H", "those of a positive definite matrix at every distance")
    return found
