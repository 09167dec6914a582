"""Windings, magnets and iron that are not as drawn: the fields of changed drawings, solved."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from femfit.core.arrays import FloatArray
from femfit.device.parts import Actuator, LinearMaterial, Material, Region
from femfit.trial.device import Conditions, Device, HiddenError, Readings
from femfit.trial.drawing_variants import (
    has_magnet,
    is_linear_iron,
    is_magnet,
    is_soft,
    remanent_core,
    scaled_magnets,
    with_curve,
)
from femfit.trial.field_table import Fields
from femfit.trial.truths.truth import FIELD, Truth

Drawings = Mapping[str, Mapping[float, Actuator]]

_STEP = 0.1
"""Relative change of a magnet, or part of a winding, that is solved."""

_FERRITE_T = 0.5


def lost_turns(where: Literal["everywhere", "outside", "end"]) -> Truth:
    """Turns that are missing all over the winding, in its outer layers or at its end, with the length of their wire."""
    family = f"turns-{where}"

    def resisted(actuator: Actuator, size: float) -> float:
        r, _ = np.array(actuator.coil.vertices_m).T
        mean = 0.5 * (r.min() + r.max())
        shorter = mean - 0.5 * size * np.ptp(r) if where == "outside" else mean
        return float((1.0 - size) * shorter / mean - 1.0)

    def fields(device: Device, size: float, at: Conditions) -> Fields:
        lost = abs(size)
        if where != "everywhere":
            return device.change(family, lost, at)
        return device.with_turns(-lost, at)

    def reading(device: Device, size: float, at: Conditions, values: Readings) -> Readings:
        change = device.actuator.coil.resistance_ohm * resisted(device.actuator, abs(size))
        return {"voltage_V": values["voltage_V"] + change * at.current}

    def drawings(actuator: Actuator) -> Drawings:
        if where == "everywhere":
            return {}
        return {family: {p: _shorter(actuator, p, where) for p in (0.5 * _STEP, _STEP)}}

    error = HiddenError(
        lambda _: 0.12, ("flux_linkage_Wb", "voltage_V"), fields=fields, reading=reading, names=("turns",)
    )
    lacks = "no winding drawn as a rectangle"
    return Truth(
        lambda _, rng: error,
        lacks=lambda drawn: "" if where == "everywhere" or is_rectangle(drawn.coil.vertices_m) else lacks,
        families=drawings,
    )


def _shorter(actuator: Actuator, lost: float, where: str) -> Actuator:
    r, z = np.array(actuator.coil.vertices_m).T
    outer = r.max() - (lost * np.ptp(r) if where == "outside" else 0.0)
    top = z.max() - (lost * np.ptp(z) if where == "end" else 0.0)
    vertices = ((r.min(), z.min()), (outer, z.min()), (outer, top), (r.min(), top))
    coil = replace(actuator.coil, vertices_m=vertices, turns=(1.0 - lost) * actuator.coil.turns)
    return replace(actuator, coils=(coil,))


def weaker_magnets(how: Literal["scaled", "grade", "shell"]) -> Truth:
    """Magnets with another remanence: throughout, with the permeability of another grade, or in their outer half."""
    family = f"remanence-{how}"
    error = HiddenError(
        lambda _: 0.2,
        FIELD,
        fields=lambda device, size, at: device.change(family, size, at),
        names=("remanence", "magnet_demagnetisation") if how == "shell" else ("remanence",),
    )
    return Truth(lambda _, rng: error, lacks=_no_magnet, families=lambda drawn: remanence_drawings(drawn, how))


def remanence_drawings(actuator: Actuator, how: str) -> Drawings:
    """The drawings of :func:`weaker_magnets`."""
    change = {"scaled": scaled_magnets, "grade": _other_grade, "shell": _weaker_shell}[how]
    return {f"remanence-{how}": {p: change(actuator, p) for p in (-_STEP, _STEP)}}


def _other_grade(actuator: Actuator, change: float) -> Actuator:
    """Stronger magnets recoil along a flatter line: mu_r falls by a fifth of what the remanence gains."""
    return _with_regions(
        actuator, lambda one: (_material(one, 1.0 + change, 1.0 - 0.2 * change),) if is_magnet(one) else (one,)
    )


def _weaker_shell(actuator: Actuator, change: float) -> Actuator:
    """The outer half of each rectangular magnet's section changed, all of any other."""

    def split(region: Region) -> tuple[Region, ...]:
        if not is_magnet(region):
            return (region,)
        if not is_rectangle(region.vertices_m):
            return (_material(region, 1.0 + change, 1.0),)
        r, _ = np.array(region.vertices_m).T
        middle = float(np.sqrt(0.5 * (r.min() ** 2 + r.max() ** 2)))
        return _cut(region, 0, middle, (1.0, 1.0 + change))

    return _with_regions(actuator, split)


def demagnetised(where: Literal["face", "back", "rim"]) -> Truth:
    """Magnets that were partly demagnetised: the third next to the gap, the one far from it, or their outer third."""
    family = f"demagnetised-{where}"

    def lost(actuator: Actuator, change: float) -> Actuator:
        moving = set(map(id, actuator.moving.regions))

        def split(region: Region) -> tuple[Region, ...]:
            if not is_magnet(region):
                return (region,)
            r, z = np.array(region.vertices_m).T
            if where == "rim":
                return _cut(region, 0, float(np.sqrt((r.min() ** 2 + 2.0 * r.max() ** 2) / 3.0)), (1.0, 1.0 - change))
            third, low = np.ptp(z) / 3.0, (id(region) in moving) == (where == "face")
            if low:
                return _cut(region, 1, z.min() + third, (1.0 - change, 1.0))
            return _cut(region, 1, z.max() - third, (1.0, 1.0 - change))

        return _with_regions(actuator, split)

    error = HiddenError(
        lambda _: 1.0,
        FIELD,
        fields=lambda device, size, at: device.change(family, abs(size), at),
        names=("magnet_demagnetisation", "remanence"),
    )
    return Truth(
        lambda _, rng: error,
        lacks=_no_rectangular_magnet,
        families=lambda drawn: {family: {p: lost(drawn, p) for p in (0.5, 1.0)}},
    )


def saturating(name: str, law: Callable[[FloatArray], FloatArray]) -> Truth:
    """Iron that is drawn without a curve and saturates by a law J / J_s of chi mu_0 H / J_s."""
    family = f"saturation-{name}"
    error = HiddenError(
        lambda _: 2.0,
        FIELD[:2],
        fields=lambda device, size, at: device.change(family, abs(size), at),
        names=("core_saturation",),
    )

    def lacks(actuator: Actuator) -> str:
        regions = (*actuator.fixed, *actuator.moving.regions)
        return "" if any(map(is_linear_iron, regions)) else "no iron without a B-H curve"

    return Truth(
        lambda _, rng: error, lacks=lacks, families=lambda drawn: {family: {1.0: with_curve(drawn, law, _FERRITE_T)}}
    )


def outer_field() -> Truth:
    """A uniform field along the axis: on the Hall element, in linear iron, through the winding.

    Soft iron in an outer field B_0 is magnetised as if it had the remanence (mu_r - 1) B_0.
    """

    def fields(device: Device, size: float, at: Conditions) -> Fields:
        r, _ = np.array(device.actuator.coil.vertices_m).T
        area = device.actuator.coil.turns * np.pi * (r.max() ** 2 + r.max() * r.min() + r.min() ** 2) / 3.0
        iron = (one.material.relative_permeability for one in device.actuator.fixed if is_soft(one))
        change = device.change("outer", (max(iron, default=1.0) - 1.0) * size, at)
        return Fields(change.force, change.flux_linkage + size * area, change.hall + size)

    def lacks(actuator: Actuator) -> str:
        soft = [one for one in actuator.fixed if is_soft(one)]
        if not soft or not all(map(is_linear_iron, soft)):
            return "no iron that is linear throughout"
        return "" if actuator.hall is not None else "no Hall element"

    error = HiddenError(lambda _: 2e-2, ("hall_V",), fields=fields, names=("external_field",))
    return Truth(
        lambda _, rng: error,
        lacks=lacks,
        families=lambda drawn: {"outer": {p: remanent_core(drawn, p) for p in (-0.02, 0.02)}},
    )


def _cut(region: Region, axis: int, at: float, factors: tuple[float, float]) -> tuple[Region, ...]:
    """A rectangle cut across r (axis 0) or z (1); remanences of the part below and of the one above, relative."""
    corners = np.array(region.vertices_m)
    low, high = corners.min(axis=0), corners.max(axis=0)
    parts = []
    for name, factor in zip(("low", "high"), factors, strict=True):
        begin, end = low.copy(), high.copy()
        (end if name == "low" else begin)[axis] = at
        (a, b), (c, d) = begin, end
        vertices = ((a, b), (c, b), (c, d), (a, d))
        changed = _material(replace(region, vertices_m=vertices), factor, 1.0)
        parts.append(replace(changed, name=f"{region.name}_{name}"))
    return tuple(parts)


def _material(region: Region, remanence: float, permeability: float) -> Region:
    material: Material = region.material
    if isinstance(material, LinearMaterial):
        material = replace(
            material,
            remanence_T=remanence * material.remanence_T,
            relative_permeability=max(1.0, permeability * material.relative_permeability),
        )
    return replace(region, material=material)


def _with_regions(actuator: Actuator, change: Callable[[Region], tuple[Region, ...]]) -> Actuator:
    fixed = tuple(part for region in actuator.fixed for part in change(region))
    moving = tuple(part for region in actuator.moving.regions for part in change(region))
    return replace(actuator, fixed=fixed, moving=replace(actuator.moving, regions=moving))


def is_rectangle(vertices: tuple[tuple[float, float], ...]) -> bool:
    """Whether an outline is a rectangle along r and z."""
    r, z = np.array(vertices).T
    on_edges = np.isin(r, [r.min(), r.max()]) & np.isin(z, [z.min(), z.max()])
    return len(vertices) == 4 and bool(on_edges.all())


def _no_magnet(actuator: Actuator) -> str:
    return "" if has_magnet(actuator) else "no magnet"


def _no_rectangular_magnet(actuator: Actuator) -> str:
    magnets = [one for one in (*actuator.fixed, *actuator.moving.regions) if is_magnet(one)]
    return "" if magnets and all(is_rectangle(one.vertices_m) for one in magnets) else "no magnet drawn as a rectangle"
