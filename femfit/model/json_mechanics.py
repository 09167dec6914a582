"""Mechanics and drive in a model file: keys of a later version are optional, and written where they say something."""

from dataclasses import MISSING, fields
from typing import TYPE_CHECKING

from femfit.device.circuit import Drive
from femfit.device.mechanics import ForceTable, Mechanics, Spring, Stop
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
    section.refuse_others(tuple(f.name for f in fields(Mechanics)))
    springs = section.sections("springs") if section.data.get("springs") else ()
    near, far = section.optional_section("near_stop"), section.optional_section("far_stop")
    mechanics = Mechanics(
        mass_kg=section.number("mass_kg", positive=True),
        gravity_m_s2=section.number("gravity_m_s2"),
        springs=tuple(_spring_from(spring) for spring in springs),
        viscous_N_s_per_m=section.number("viscous_N_s_per_m", lower=0.0, absent=0.0),
        coulomb_N=section.number("coulomb_N", lower=0.0, absent=0.0),
        load_N=section.number("load_N", absent=0.0),
        near_stop=None if near is None else _stop_from(near),
        far_stop=None if far is None else _stop_from(far),
    )
    both = mechanics.near_stop is not None and mechanics.far_stop is not None
    if both and not mechanics.near_stop.distance_m < mechanics.far_stop.distance_m:  # type: ignore[union-attr]
        raise section.refusal("far_stop", "at a larger distance than near_stop")
    return mechanics


def _spring_from(section: Section) -> Spring | ForceTable:
    if "stiffness_N_per_m" in section.data:
        section.refuse_others(tuple(f.name for f in fields(Spring)))
        return Spring(
            section.number("stiffness_N_per_m"),
            section.number("preload_N", absent=0.0),
            section.number("distance_m", absent=0.0),
        )
    section.refuse_others(tuple(f.name for f in fields(ForceTable)))
    distances, forces = section.array("distances_m", 1), section.array("forces_N", 1)
    if len(distances) < 2 or not (distances[1:] > distances[:-1]).all():
        raise section.refusal("distances_m", "two or more distances in ascending order")
    if len(forces) != len(distances):
        raise section.refusal("forces_N", f"{len(distances)} forces, one for each distance")
    return ForceTable(tuple(distances.tolist()), tuple(forces.tolist()))


def _stop_from(section: Section) -> Stop:
    section.refuse_others(tuple(f.name for f in fields(Stop)))
    restitution = section.number("restitution", lower=0.0, absent=0.0)
    if restitution > 1.0:
        raise section.refusal("restitution", "0 to 1")
    stiffness = None
    if section.data.get("stiffness_N_per_m") is not None:
        stiffness = section.number("stiffness_N_per_m", positive=True)
    return Stop(section.number("distance_m"), restitution, stiffness)


def drive_from(section: Section) -> Drive:
    """What feeds the winding."""
    kind = section.text("kind")
    if kind not in {"voltage", "current"}:
        raise section.refusal("kind", "voltage or current")
    return section.record(Drive, kind=kind)
