"""Sensors beside the Hall element in a model file."""

import math
from dataclasses import fields
from typing import Any

from femfit.device.sensors import AccelerationSensor, CurrentSensor, ForceSensor, PositionSensor
from femfit.model.json_section import Section
from femfit.model.json_sensed import sensed_from
from femfit.model.other_sensor import OtherSensor
from femfit.model.pickup import PickupSensor

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
    section.refuse_others(tuple(f.name for f in fields(KINDS[kind])))
    timing = None if section.data.get("sample_time_s") is None else section.number("sample_time_s", positive=True)
    low, high = section.optional_number("minimum"), section.optional_number("maximum")
    if not (-math.inf if low is None else low) < (math.inf if high is None else high):
        raise section.refusal("maximum", "above minimum")
    common: dict[str, Any] = {
        "name": section.text("name"),
        "noise": section.number("noise", lower=0.0, absent=0.0),
        "minimum": low,
        "maximum": high,
        "bits": section.integer("bits", 0, 64) if "bits" in section.data else 0,
        "delay_s": section.number("delay_s", lower=0.0, absent=0.0),
        "sample_time_s": timing,
    }
    if kind == "current":
        gain, offset = section.number("gain", absent=1.0), section.number("offset", absent=0.0)
        return CurrentSensor(**common, circuit=section.text("circuit"), gain=gain, offset=offset)
    if kind == "position":
        at, read = section.array("distances_m", 1), section.array("readings", 1)
        rises = read[1:] - read[:-1]
        if len(at) < 2 or len(at) != len(read) or not (at[1:] > at[:-1]).all() or not (rises * rises[0] > 0.0).all():
            raise section.refusal("readings", "as many as distances_m, rising or falling throughout as those ascend")
        unit = section.text("unit")
        return PositionSensor(**common, distances_m=tuple(at.tolist()), readings=tuple(read.tolist()), unit=unit)
    if kind == "pickup_coil":
        return PickupSensor(**common, flux=sensed_from(section.section("flux")))
    if kind == "acceleration":
        return AccelerationSensor(
            **common, reads_gravity="reads_gravity" in section.data and section.truth("reads_gravity")
        )
    return ForceSensor(**common)
