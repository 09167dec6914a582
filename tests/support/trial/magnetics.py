"""Windings, magnets and iron that are not as drawn: the fields of changed drawings, solved."""

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np

from femfit.core.numerics import FloatArray
from femfit.device.parts import Actuator, LinearMaterial, Region
from femfit.trial.field_table import HiddenError
from femfit.trial.hidden import is_linear_iron, is_magnet, is_soft, saturable_core, scaled_magnets
from support.trial.truth import FIELD, Drawings, Truth, always

_STEP = 0.1
"""Relative change of a magnet, or part of a winding, that is solved."""

_FERRITE_T = 0.5


def lost_turns(where: Literal["everywhere", "outside", "end"]) -> Truth:
    """Turns that are missing all over the winding, in its outer layers or at its end, with the length of their wire."""
    family = f"turns-{where}"

    def resisted(actuator, size):
        r, _ = np.array(actuator.coil.vertices_m).T
        mean = 0.5 * (r.min() + r.max())
        shorter = mean - 0.5 * size * np.ptp(r) if where == "outside" else mean
        return float((1.0 - size) * shorter / mean - 1.0)

    def fields(device, size, settings):
        if where == "everywhere":
            return device.with_turns(-abs(size), settings)
        return device.change(family, abs(size), settings)

    def reading(device, size, settings, values):
        change = device.actuator.coil.resistance_ohm * resisted(device.actuator, abs(size))
        return {"voltage_V": values["voltage_V"] + change * settings.current}

    def drawings(actuator):
        if where == "everywhere":
            return {}
        return {family: {p: _shorter(actuator, p, where) for p in (0.5 * _STEP, _STEP)}}

    def lacks(actuator):
        rectangular = where == "everywhere" or is_rectangle(actuator.coil.vertices_m)
        return "" if rectangular else "no winding drawn as a rectangle"

    error = HiddenError(lambda device: 0.12, ("flux_linkage_Wb", "voltage_V"), fields=fields, reading=reading)
    return always(error, lacks=lacks, families=drawings)


def _shorter(actuator: Actuator, lost: float, where: str) -> Actuator:
    r, z = np.array(actuator.coil.vertices_m).T
    outer = r.max() - (lost * np.ptp(r) if where == "outside" else 0.0)
    top = z.max() - (lost * np.ptp(z) if where == "end" else 0.0)
    vertices = ((r.min(), z.min()), (outer, z.min()), (outer, top), (r.min(), top))
    coil = replace(actuator.coil, vertices_m=vertices, turns=(1.0 - lost) * actuator.coil.turns)
    return replace(actuator, coils=(coil,))


def weaker_magnets(how: Literal["scaled", "grade", "shell"]) -> Truth:
    """Magnets with another remanence: throughout, with the permeability of another grade, or in their outer half."""
    return always(
        HiddenError(
            lambda device: 0.2,
            FIELD,
            fields=lambda device, size, settings: device.change(f"remanence-{how}", size, settings),
            names=("remanence", "magnet_demagnetisation") if how == "shell" else ("remanence",),
        ),
        lacks=lambda drawn: "" if any(map(is_magnet, drawn.regions)) else "no magnet",
        families=lambda drawn: remanence_drawings(drawn, how),
    )


def remanence_drawings(actuator: Actuator, how: str) -> Drawings:
    """The drawings of :func:`weaker_magnets`."""
    change = {"scaled": scaled_magnets, "grade": _other_grade, "shell": _weaker_shell}[how]
    return {f"remanence-{how}": {p: change(actuator, p) for p in (-_STEP, _STEP)}}


def _other_grade(actuator: Actuator, change: float) -> Actuator:
    """Stronger magnets recoil along a flatter line: mu_r falls by a fifth of what the remanence gains."""
    return _with_magnets(actuator, lambda magnet: (_material(magnet, 1.0 + change, 1.0 - 0.2 * change),))


def _weaker_shell(actuator: Actuator, change: float) -> Actuator:
    """The outer half of each rectangular magnet's section changed, all of any other."""

    def split(magnet):
        if not is_rectangle(magnet.vertices_m):
            return (_material(magnet, 1.0 + change),)
        r, _ = np.array(magnet.vertices_m).T
        return _cut(magnet, 0, float(np.sqrt(0.5 * (r.min() ** 2 + r.max() ** 2))), (1.0, 1.0 + change))

    return _with_magnets(actuator, split)


def demagnetised(where: Literal["face", "back", "rim"]) -> Truth:
    """Magnets that were partly demagnetised: the third next to the gap, the one far from it, or their outer third."""
    family = f"demagnetised-{where}"

    def weakened(actuator, change):
        moving = set(map(id, actuator.moving.regions))

        def split(magnet):
            r, z = np.array(magnet.vertices_m).T
            if where == "rim":
                return _cut(magnet, 0, float(np.sqrt((r.min() ** 2 + 2.0 * r.max() ** 2) / 3.0)), (1.0, 1.0 - change))
            third = np.ptp(z) / 3.0
            if (id(magnet) in moving) == (where == "face"):
                return _cut(magnet, 1, z.min() + third, (1.0 - change, 1.0))
            return _cut(magnet, 1, z.max() - third, (1.0, 1.0 - change))

        return _with_magnets(actuator, split)

    def lacks(actuator):
        magnets = list(filter(is_magnet, (*actuator.fixed, *actuator.moving.regions)))
        drawn = magnets and all(is_rectangle(magnet.vertices_m) for magnet in magnets)
        return "" if drawn else "no magnet drawn as a rectangle"

    return always(
        HiddenError(
            lambda device: 1.0,
            FIELD,
            fields=lambda device, size, settings: device.change(family, abs(size), settings),
            names=("magnet_demagnetisation", "remanence"),
        ),
        lacks=lacks,
        families=lambda drawn: {family: {p: weakened(drawn, p) for p in (0.5, 1.0)}},
    )


def saturating(name: str, law: Callable[[FloatArray], FloatArray]) -> Truth:
    """Iron that is drawn without a curve and saturates by a law J / J_s of chi mu_0 H / J_s."""
    family = f"saturation-{name}"

    def lacks(actuator):
        regions = (*actuator.fixed, *actuator.moving.regions)
        return "" if any(map(is_linear_iron, regions)) else "no iron without a B-H curve"

    return always(
        HiddenError(
            lambda device: 2.0,
            FIELD[:2],
            fields=lambda device, size, settings: device.change(family, abs(size), settings),
        ),
        lacks=lacks,
        families=lambda drawn: {family: {1.0: saturable_core(drawn, _FERRITE_T, law)}},
    )


def outer_field() -> Truth:
    """A uniform field along the axis: on the Hall element, in linear iron, through the winding.

    Soft iron in an outer field B_0 is magnetised as if it had the remanence (mu_r - 1) B_0.
    """

    def fields(device, size, settings):
        r, _ = np.array(device.actuator.coil.vertices_m).T
        area = device.actuator.coil.turns * np.pi * (r.max() ** 2 + r.max() * r.min() + r.min() ** 2) / 3.0
        iron = (region.material.relative_permeability for region in filter(is_soft, device.actuator.fixed))
        change = device.change("outer", (max(iron, default=1.0) - 1.0) * size, settings)
        return change + size * np.array([[0.0], [area], [1.0]])

    def lacks(actuator):
        soft = list(filter(is_soft, actuator.fixed))
        if not soft or not all(map(is_linear_iron, soft)):
            return "no iron that is linear throughout"
        return "" if actuator.hall is not None else "no Hall element"

    return always(
        HiddenError(lambda device: 2e-2, ("hall_V",), fields=fields),
        lacks=lacks,
        families=lambda drawn: {"outer": {p: magnetised_iron(drawn, p, lambda region: 1.0) for p in (-0.02, 0.02)}},
    )


def magnetised_iron(actuator: Actuator, remanence: float, way: Callable[[Region], float]) -> Actuator:
    """The fixed soft parts with a remanence in T along the axis, the way that each has it."""

    def magnetised(region):
        if not is_soft(region):
            return region
        return replace(
            region, material=LinearMaterial("core", region.material.relative_permeability, way(region) * remanence)
        )

    return replace(actuator, fixed=tuple(map(magnetised, actuator.fixed)))


def _cut(region: Region, axis: int, place: float, factors: tuple[float, float]) -> tuple[Region, ...]:
    """A rectangle cut across r (axis 0) or z (1); remanences of the part below and of the one above, relative."""
    corners = np.array(region.vertices_m)
    low, high = corners.min(axis=0), corners.max(axis=0)
    parts = []
    for name, factor in zip(("low", "high"), factors, strict=True):
        begin, end = low.copy(), high.copy()
        (end if name == "low" else begin)[axis] = place
        (a, b), (c, d) = begin, end
        piece = replace(region, name=f"{region.name}_{name}", vertices_m=((a, b), (c, b), (c, d), (a, d)))
        parts.append(_material(piece, factor))
    return tuple(parts)


def _material(magnet: Region, remanence: float, permeability: float = 1.0) -> Region:
    """A magnet with factors on its remanence and permeability."""
    material = magnet.material
    if not isinstance(material, LinearMaterial):
        return magnet
    mu = max(1.0, permeability * material.relative_permeability)
    changed = replace(material, remanence_T=remanence * material.remanence_T, relative_permeability=mu)
    return replace(magnet, material=changed)


def _with_magnets(actuator: Actuator, change: Callable[[Region], tuple[Region, ...]]) -> Actuator:
    def changed(regions):
        return tuple(part for region in regions for part in (change(region) if is_magnet(region) else (region,)))

    moving = replace(actuator.moving, regions=changed(actuator.moving.regions))
    return replace(actuator, fixed=changed(actuator.fixed), moving=moving)


def is_rectangle(vertices: tuple[tuple[float, float], ...]) -> bool:
    """Whether an outline is a rectangle along r and z."""
    r, z = np.array(vertices).T
    on_edges = np.isin(r, [r.min(), r.max()]) & np.isin(z, [z.min(), z.max()])
    return len(vertices) == 4 and bool(on_edges.all())
