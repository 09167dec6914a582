"""An imported FEMM model as the text of an actuator file, with a comment for everything that it did not hold.

``actuator.toml.j2`` is that file; here are its numbers, names and lists.
"""

import json
import re
from collections.abc import Iterator, Sequence
from functools import partial
from importlib.resources import files
from typing import Any

from jinja2 import StrictUndefined, Template

from femfit.tables.femm.faces import Edge, FemPiece
from femfit.tables.femm.frame import COPPER_FILL, FemDevice
from femfit.tables.femm.model import FemMaterial
from femfit.tables.femm.parts import volume_mm3

EXACT = 17
"""Digits that print a double without loss: the sweep must hold the file's own point."""

MAGNET_DENSITY, STEEL_DENSITY, COPPER_DENSITY = 7.5, 7.85, 8.96
"""Sintered NdFeB, low-carbon steel and copper in g/cm^3: makers' data sheets agree to 1 %."""


_string = partial(json.dumps, ensure_ascii=False)
"""A TOML basic string."""


def number(value: float, digits: int = 12) -> str:
    """The shortest text of a number with so many significant digits; whole numbers without a point."""
    rounded = float(f"{value:.{digits}g}") + 0.0
    return str(int(rounded)) if rounded.is_integer() and abs(rounded) < 1e15 else repr(rounded)


def free_name(name: str, taken: set[str]) -> str:
    """A region's name from a block's: letters, digits, - and _, beginning with a letter, not yet taken."""
    stem = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")[:50]
    stem = stem if re.match(r"[a-z]", stem) else f"part_{stem}".rstrip("_")
    free = next(
        candidate for n in range(1, len(taken) + 2) if (candidate := stem if n == 1 else f"{stem}_{n}") not in taken
    )
    taken.add(free)
    return free


def plain(text: str) -> str:
    """On one line of a comment."""
    return "".join(character if character.isprintable() else " " for character in text)


def rectangle(outline: Sequence[Edge]) -> tuple[float, ...]:
    """Both radii and both heights of an outline that is a box; nothing of another one."""
    radii, heights = ({point[k] for point in outline} for k in (0, 1))
    box = len(outline) == 4 and len(radii) == 2 and len(heights) == 2 and not any(angle for _, _, angle in outline)
    return (*sorted(radii), *sorted(heights)) if box else ()


def corners(outline: Sequence[Edge]) -> list[str]:
    """The corners of an outline, each with the angle of its arc where it has one."""
    return [f"[{', '.join(map(number, edge if edge[2] else edge[:2]))}]" for edge in outline]


def curve(material: FemMaterial) -> list[tuple[str, list[str]]]:
    """The keys of a magnetisation curve with their numbers."""
    columns = zip(*material.curve, strict=True)
    return [
        (key, [number(value, EXACT) for value in values])
        for key, values in zip(("B_T", "H_A_per_m"), columns, strict=True)
    ]


def actuator_toml(device: FemDevice) -> str:
    """The text of an actuator file."""
    text = (files("femfit.tables.femm") / "actuator.toml.j2").read_text(encoding="utf-8")
    template = Template(
        text, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True, undefined=StrictUndefined
    )
    functions = {function.__name__: function for function in (number, plain, rectangle, corners, curve)}
    return str(template.render(_facts(device) | functions | {"string": _string}))


def _facts(device: FemDevice) -> dict[str, Any]:
    """What the template is filled with."""
    outlines, taken, bodies, model = device.outlines(), {"air"}, device.bodies, device.model
    standing, body = ([piece for piece in pieces if not piece.turns] for pieces in (bodies.fixed, bodies.moving))
    fixed = [region for part in standing for region in _regions(device, part, outlines[id(part)], taken)]
    coils = [
        {
            "name": free_name(winding.circuit.name, taken),
            "origin": f"circuit {winding.circuit.name!r}: {'; '.join(label.place for label in coil.labels)}",
            "outline": outlines[id(coil)][0],
            "turns": abs(coil.turns),
            "wire": device.wires[id(coil)],
            "moves": any(coil is piece for piece in bodies.moving),
        }
        for winding in device.windings
        for coil in winding.coils
    ]
    moving = [region for part in body for region in _regions(device, part, outlines[id(part)], taken)]
    names, free = iter(coils), set[str]()
    circuits = {
        free_name(winding.circuit.name, free): [
            _string(f"{'-' if coil.turns * winding.sign < 0 else ''}{next(names)['name']}") for coil in winding.coils
        ]
        for winding in device.windings
    }
    axes = [f"[{number(device.frame.current(winding), EXACT)}]" for winding in device.windings]
    pairs = (f"{name} = {values}" for name, values in zip(circuits, axes, strict=True))
    return {
        "device": device,
        "model": model,
        "frame": device.frame,
        "comment": f" ({plain(model.comment)})" if model.comment not in {"", "Add comments here."} else "",
        "materials": dict.fromkeys(part.material for part in (*standing, *body)),
        "fixed": fixed,
        "coils": coils,
        "moving": moving,
        "circuits": circuits if len(coils) > 1 else {},  # else the circuit is the coil
        "mass": _mass(device),
        "supply": _supply(device),
        "currents": axes[0] if len(axes) == 1 else f"{{ {', '.join(pairs)} }}" if axes else "",
        "distances": f"[{number(device.frame.distance_mm, EXACT)}]",
    }


def _regions(
    device: FemDevice, part: FemPiece, outlines: Sequence[Sequence[Edge]], taken: set[str]
) -> Iterator[dict[str, Any]]:
    """The tables of the actuator file for a part."""
    origin = "; ".join(f"{label.place}, group {label.group}" for label in part.labels)
    origin += f"; a closed ring, cut into {len(outlines)} pieces" if len(outlines) > 1 else ""
    r, z = device.frame.direction(part) or (0.0, 0.0)
    direction = f"[{number(r)}, {number(z)}]"
    if r == 0.0 or z == 0.0:
        direction = f'"{"-" if r + z < 0 else "+"}{"z" if r == 0.0 else "r"}"' if part.direction else ""
    for outline in outlines:
        name = free_name(part.material.name, taken)
        yield {"name": name, "origin": origin, "outline": outline, "material": part.material, "direction": direction}


def _mass(device: FemDevice) -> str:
    """The moving part's mass in g, and where it is from."""
    moving = device.bodies.moving
    weights = [
        (MAGNET_DENSITY if piece.direction else STEEL_DENSITY, volume_mm3(piece.polygon) * 1e-3)
        for piece in moving
        if piece.material.magnetic
    ]
    weights += [(COPPER_FILL * COPPER_DENSITY, volume_mm3(coil.polygon) * 1e-3) for coil in moving if coil.turns]
    mass = sum(density * volume for density, volume in weights)
    shown = " + ".join(f"{volume:.5g} cm^3 x {density:g} g/cm^3" for density, volume in weights if volume)
    return f"{number(mass, 5)} # ASSUMED density: {shown}; weigh the body and correct it"


def _supply(device: FemDevice) -> tuple[float, float] | None:
    """Voltages of the resistances that the sweep's currents need; None without a winding."""
    if not device.windings:
        return None
    bounds, resistances = [0.0], []
    for winding in device.windings:
        resistances.append(sum(device.wires[id(coil)].resistance_ohm for coil in winding.coils))
        bounds.append(resistances[-1] * device.frame.current(winding))
    low, high = min(bounds), max(bounds)
    return low, high if high > low else max(resistances)
