"""Windings, magnets and iron that are not as drawn: the fields of changed drawings, solved."""

from dataclasses import replace

import numpy as np

from femfit.device.parts import LinearMaterial
from femfit.trial.field_table import HiddenError
from femfit.trial.hidden import is_linear_iron, is_magnet, is_soft, saturable_core, scaled_magnets
from support.trial.truth import FIELD, always, needing, needing_magnet, of_family

_STEP = 0.1
"""Relative change of a magnet, or part of a winding, that is solved."""

_FERRITE_T = 0.5


def lost_turns(where):
    """Turns that are missing ``everywhere``, in the ``outside`` layers or at the ``end``, with their wire's length."""
    family = f"turns-{where}"

    def fields(device, size, settings):
        if where == "everywhere":
            return device.with_turns(-abs(size), settings)
        return device.change(family, abs(size), settings)

    def reading(device, size, settings, values):
        r, _ = np.array(device.actuator.coil.vertices_m).T
        mean = 0.5 * (r.min() + r.max())
        shorter = mean - 0.5 * abs(size) * np.ptp(r) * (where == "outside")
        change = device.actuator.coil.resistance_ohm * ((1.0 - abs(size)) * shorter / mean - 1.0)
        return {"voltage_V": values["voltage_V"] + change * settings.current}

    error = HiddenError(lambda device: 0.12, ("flux_linkage_Wb", "voltage_V"), fields=fields, reading=reading)
    if where == "everywhere":
        return always(error)
    lacks = needing("winding drawn as a rectangle", lambda drawn: is_rectangle(drawn.coil.vertices_m))
    parts = 0.5 * _STEP, _STEP
    return always(error, lacks=lacks, families=lambda drawn: {family: {p: _shorter(drawn, p, where) for p in parts}})


def _shorter(actuator, lost, where):
    r, z = np.array(actuator.coil.vertices_m).T
    outer = r.max() - (lost * np.ptp(r) if where == "outside" else 0.0)
    top = z.max() - (lost * np.ptp(z) if where == "end" else 0.0)
    vertices = ((r.min(), z.min()), (outer, z.min()), (outer, top), (r.min(), top))
    return replace(
        actuator, coils=(replace(actuator.coil, vertices_m=vertices, turns=(1.0 - lost) * actuator.coil.turns),)
    )


def weaker_magnets(how):
    """Magnets with another remanence: ``scaled``, with the permeability of another ``grade``, or in their ``shell``."""
    names = ("remanence", "magnet_demagnetisation") if how == "shell" else ("remanence",)
    error = of_family(f"remanence-{how}", 0.2, one_way=False, names=names)
    return always(error, lacks=needing_magnet, families=lambda drawn: remanence_drawings(drawn, how))


def remanence_drawings(actuator, how):
    """The drawings of :func:`weaker_magnets`; stronger magnets of another grade recoil along a flatter line."""

    def grade(drawn, change):
        return _with_magnets(drawn, lambda magnet: (_material(magnet, 1.0 + change, 1.0 - 0.2 * change),))

    def shell(drawn, change):
        return _with_magnets(drawn, lambda magnet: _in_two(magnet, 0.5, (1.0, 1.0 + change)))

    make = {"scaled": scaled_magnets, "grade": grade, "shell": shell}[how]
    return {f"remanence-{how}": {p: make(actuator, p) for p in (-_STEP, _STEP)}}


def demagnetised(where):
    """Magnets that were partly demagnetised: a third at the ``face`` to the gap, at the ``back``, or at the ``rim``."""
    family = f"demagnetised-{where}"

    def weakened(actuator, change):
        moving = set(map(id, actuator.moving.regions))

        def split(magnet):
            if where == "rim":
                return _in_two(magnet, 2.0 / 3.0, (1.0, 1.0 - change))
            _, z = np.array(magnet.vertices_m).T
            third = np.ptp(z) / 3.0
            if (id(magnet) in moving) == (where == "face"):
                return _cut(magnet, 1, z.min() + third, (1.0 - change, 1.0))
            return _cut(magnet, 1, z.max() - third, (1.0, 1.0 - change))

        return _with_magnets(actuator, split)

    def drawn_as_rectangles(drawn):
        magnets = list(filter(is_magnet, drawn.regions))
        return magnets and all(is_rectangle(magnet.vertices_m) for magnet in magnets)

    return always(
        of_family(family, 1.0, names=("magnet_demagnetisation", "remanence")),
        lacks=needing("magnet drawn as a rectangle", drawn_as_rectangles),
        families=lambda drawn: {family: {p: weakened(drawn, p) for p in (0.5, 1.0)}},
    )


def saturating(name, law):
    """Iron that is drawn without a curve and saturates by a law J / J_s of chi mu_0 H / J_s."""
    family = f"saturation-{name}"
    return always(
        of_family(family, 2.0, FIELD[:2]),
        lacks=needing("iron without a B-H curve", lambda drawn: any(map(is_linear_iron, drawn.regions))),
        families=lambda drawn: {family: {1.0: saturable_core(drawn, _FERRITE_T, law)}},
    )


def outer_field():
    """A uniform field B_0 along the axis, which magnetises soft iron as a remanence (mu_r - 1) B_0 would."""

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


def magnetised_iron(actuator, remanence, way):
    """The fixed soft parts with a remanence in T along the axis, the way that each has it."""

    def magnetised(region):
        if not is_soft(region):
            return region
        material = LinearMaterial("core", region.material.relative_permeability, way(region) * remanence)
        return replace(region, material=material)

    return replace(actuator, fixed=tuple(map(magnetised, actuator.fixed)))


def _in_two(magnet, share, factors):
    """A magnet whose inner share of the section's area, and the rest, have factors of their own; all the last one's
    where it is no rectangle."""
    if not is_rectangle(magnet.vertices_m):
        return (_material(magnet, factors[1]),)
    r, _ = np.array(magnet.vertices_m).T
    return _cut(magnet, 0, float(np.sqrt((1.0 - share) * r.min() ** 2 + share * r.max() ** 2)), factors)


def _cut(region, axis, place, factors):
    """A rectangle cut across r (axis 0) or z (1); remanences of the part below and of the one above, relative."""
    low, high = np.min(region.vertices_m, axis=0), np.max(region.vertices_m, axis=0)
    middle = np.where(np.arange(2) == axis, place, (low, high))
    parts = []
    for name, (a, b), (c, d), factor in zip(("low", "high"), (low, middle[0]), (middle[1], high), factors, strict=True):
        piece = replace(region, name=f"{region.name}_{name}", vertices_m=((a, b), (c, b), (c, d), (a, d)))
        parts.append(_material(piece, factor))
    return tuple(parts)


def _material(magnet, remanence, permeability=1.0):
    """A magnet with factors on its remanence and permeability."""
    material = magnet.material
    mu = max(1.0, permeability * material.relative_permeability)
    changed = replace(material, remanence_T=remanence * material.remanence_T, relative_permeability=mu)
    return replace(magnet, material=changed)


def _with_magnets(actuator, change):
    def changed(regions):
        return tuple(part for region in regions for part in (change(region) if is_magnet(region) else (region,)))

    moving = replace(actuator.moving, regions=changed(actuator.moving.regions))
    return replace(actuator, fixed=changed(actuator.fixed), moving=moving)


def is_rectangle(vertices):
    """Whether an outline is a rectangle along r and z."""
    r, z = np.array(vertices).T
    on_edges = np.isin(r, [r.min(), r.max()]) & np.isin(z, [z.min(), z.max()])
    return len(vertices) == 4 and bool(on_edges.all())
