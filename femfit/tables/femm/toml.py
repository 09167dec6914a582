"""An imported FEMM model as the text of an actuator file, with a comment for everything that it did not hold.

Numbers, names, lists and comments of an actuator file that is written.
"""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from decimal import Decimal
from itertools import pairwise

from femfit.tables.femm.faces import Edge
from femfit.tables.femm.frame import FemDevice, FemFrame
from femfit.tables.femm.model import FemModel
from femfit.tables.femm.movers import FemBodies
from femfit.tables.femm.options import FemOptions
from femfit.tables.femm.parts import FemPart, volume_mm3
from femfit.tables.femm.winding import COPPER_FILL, FemCoil, FemWinding

EXACT = 17
"""Digits that print a double without loss: the sweep must hold the file's own point."""


def written_list(key: str, items: Sequence[str], remark: str = "") -> Iterator[str]:
    """A key with a list, on one line or six items a line."""
    if len(items) <= 6:
        yield f"{key} = [{', '.join(items)}]{remark}"
        return
    yield f"{key} = [{remark}"
    yield from (f"  {', '.join(items[k : k + 6])}," for k in range(0, len(items), 6))
    yield "]"


def axis(values: Sequence[float]) -> str:
    """A grid as a range where it is one, else as a list."""
    exact = [Decimal(repr(float(value))) for value in values]
    steps = {after - before for before, after in pairwise(exact)}
    if len(values) > 3 and len(steps) == 1:
        start, stop, step = (number(value, EXACT) for value in (values[0], values[-1], float(steps.pop())))
        return f"{{ start = {start}, stop = {stop}, step = {step} }}"
    return f"[{', '.join(number(value, EXACT) for value in values)}]"


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


def string(text: str) -> str:
    """A TOML basic string."""
    return json.dumps(text, ensure_ascii=False)


def plain(text: str) -> str:
    """On one line of a comment."""
    return "".join(character if character.isprintable() else " " for character in text)


MAGNET_DENSITY, STEEL_DENSITY, COPPER_DENSITY = 7.5, 7.85, 8.96
"""Sintered NdFeB, low-carbon steel and copper in g/cm^3: makers' data sheets agree to 1 %."""

Outlines = Mapping[int, Sequence[Sequence[Edge]]]
"""Of each part and coil in the actuator file, by its id."""


def actuator_toml(device: FemDevice) -> str:
    """The text of an actuator file."""
    outlines = device.outlines()
    taken: set[str] = {"air"}
    bodies = device.bodies
    lines = [
        *_head(device),
        "",
        "schema = 2",
        f"name = {string(device.name)}",
        f"description = {string(f'From the FEMM model {plain(device.model.source)}')}",
        *_materials([*bodies.fixed, *bodies.moving]),
        *(line for part in bodies.fixed for line in _regions(part, "fixed", device.frame, outlines, taken)),
        *_coils(device, outlines, taken),
        *("", "[mechanics]"),
        *_mass(bodies, device.options),
        *(line for part in bodies.moving for line in _regions(part, "moving", device.frame, outlines, taken)),
        *_supply(device),
        "",
        "[sweep] # holds the file's own point",
        *_currents(device),
        f"distance_mm = {axis(device.distances_mm)}",
    ]
    return "\n".join(lines) + "\n"


def _head(device: FemDevice) -> Iterator[str]:
    model, frame = device.model, device.frame
    turned = "; current and flux linkage have the opposite sign here"
    currents = [
        f", {number(winding.circuit.current_A)} A{turned if frame.current_sign(winding) < 0 else ''}"
        for winding in device.windings
    ]
    yield f"# Imported from the FEMM model {plain(model.source)}{_comment_of(model)}."
    yield "# Lengths in mm, cylindrical (r, z); the fixed parts' face, from which distances are counted, is z = 0 and"
    yield "# z grows towards the moving part, which is drawn at distance 0."
    yield f"# The file's z (in {model.unit} there) is {number(frame.face_mm)} mm {'+' if frame.up > 0 else '-'} this z."
    fields = "; every field has the opposite sign here" if frame.field_sign < 0 else ""
    yield f"# Its own point: {number(frame.distance_mm)} mm{''.join(currents)}{fields}."


def _materials(parts: Iterable[FemPart]) -> Iterator[str]:
    for material in dict.fromkeys(part.material for part in parts):
        yield from ("", f"[materials.{string(material.name)}]")
        if material.curve:
            for key, values in zip(("B_T", "H_A_per_m"), zip(*material.rising_curve, strict=True), strict=True):
                yield from written_list(key, [number(value, EXACT) for value in values])
            continue
        yield f"relative_permeability = {number(material.mu_y)}"
        if material.coercivity:
            yield f"remanence_T = {number(material.remanence)} # mu_0 mu_r H_c of {abs(material.coercivity):.6g} A/m"


def _regions(part: FemPart, body: str, frame: FemFrame, outlines: Outlines, taken: set[str]) -> Iterator[str]:
    pieces = outlines[id(part)]
    origin = "; ".join(f"{label.place}, group {label.group}" for label in part.labels)
    for outline in pieces:
        yield from ("", f"[{body}.regions.{free_name(part.material.name, taken)}]")
        cut = f"; a closed ring, cut into {len(pieces)} pieces" if len(pieces) > 1 else ""
        yield f"material = {string(part.material.name)} # {plain(origin)}{cut}"
        direction = frame.direction(part)
        if direction is not None:
            yield f"magnetization = {_direction(*direction)}"
        yield from _outline(outline)


def _direction(r: float, z: float) -> str:
    if r == 0.0 or z == 0.0:
        return f'"{"-" if r + z < 0 else "+"}{"z" if r == 0.0 else "r"}"'
    return f"[{number(r)}, {number(z)}]"


def _coils(device: FemDevice, outlines: Outlines, taken: set[str]) -> Iterator[str]:
    names = {id(coil): free_name(winding.circuit.name, taken) for winding in device.windings for coil in winding.coils}
    for winding in device.windings:
        for coil in winding.coils:
            yield from ("", f"[coils.{names[id(coil)]}]")
            yield from _winding(device, winding, coil, outlines)
            if any(coil is moving for moving in device.bodies.moving_coils):
                yield "moves = true"
    if len(names) == 1:
        return  # the circuit is the coil
    for name, winding in zip(_circuit_names(device), device.windings, strict=True):
        signed = [f"{'-' if coil.turns * winding.sign < 0 else ''}{names[id(coil)]}" for coil in winding.coils]
        yield from ("", f"[circuits.{name}]")
        yield from written_list("coils", [string(coil) for coil in signed])


def _circuit_names(device: FemDevice) -> list[str]:
    taken: set[str] = set()
    return [free_name(winding.circuit.name, taken) for winding in device.windings]


def _winding(device: FemDevice, winding: FemWinding, coil: FemCoil, outlines: Outlines) -> Iterator[str]:
    wire = device.wires[id(coil)]
    places = "; ".join(label.place for label in coil.labels)
    yield from _outline(outlines[id(coil)][0], f"circuit {winding.circuit.name!r}: {places}")
    yield f"turns = {number(abs(coil.turns))}"
    if wire.diameter_mm is not None:
        yield f"wire_diameter_mm = {number(wire.diameter_mm)} # {plain(wire.diameter_origin)}"
    if wire.resistance_origin:
        yield f"resistance_ohm = {number(wire.resistance_ohm, 6)} # {plain(wire.resistance_origin)}"


def _mass(bodies: FemBodies, options: FemOptions) -> Iterator[str]:
    if options.mass_g is not None:
        yield f"mass_g = {number(options.mass_g)}"
        return
    density_given = options.density_g_per_cm3
    weights = [
        (density_given or (MAGNET_DENSITY if part.direction else STEEL_DENSITY), volume_mm3(part.polygon) * 1e-3)
        for part in bodies.moving
        if part.material.magnetic
    ]
    weights += [
        (density_given or COPPER_FILL * COPPER_DENSITY, volume_mm3(coil.polygon) * 1e-3) for coil in bodies.moving_coils
    ]
    mass = sum(density * volume for density, volume in weights)
    shown = " + ".join(f"{volume:.5g} cm^3 x {density:g} g/cm^3" for density, volume in weights if volume)
    origin = "" if density_given else "ASSUMED density: "
    yield f"mass_g = {number(mass, 5)} # {origin}{shown}; weigh the body and correct it"


def _supply(device: FemDevice) -> Iterator[str]:
    if not device.windings:
        return
    bounds, resistances = [0.0], []
    for winding in device.windings:
        resistances.append(sum(device.wires[id(coil)].resistance_ohm for coil in winding.coils))
        bounds += [resistances[-1] * current for current in device.currents(winding)]
    low, high = min(bounds), max(bounds)
    yield from ("", "[supply] # ASSUMED: what the winding needs for the currents below; the file has no driver")
    yield f"voltage_min_V = {number(low, 3)}"
    yield f"voltage_max_V = {number(high if high > low else max(resistances), 3)}"


def _currents(device: FemDevice) -> Iterator[str]:
    axes = [axis(device.currents(winding)) for winding in device.windings]
    if len(axes) == 1:
        yield f"current_A = {axes[0]}"
    elif axes:
        pairs = (f"{name} = {values}" for name, values in zip(_circuit_names(device), axes, strict=True))
        yield f"current_A = {{ {', '.join(pairs)} }}"


def _outline(outline: Sequence[Edge], comment: str = "") -> Iterator[str]:
    remark = f" # {plain(comment)}" if comment else ""
    radii, heights = ({point[k] for point in outline} for k in (0, 1))
    if len(outline) == 4 and len(radii) == 2 and len(heights) == 2 and not any(angle for _, _, angle in outline):
        yield f"r_mm = [{number(min(radii))}, {number(max(radii))}]{remark}"
        yield f"z_mm = [{number(min(heights))}, {number(max(heights))}]"
        return
    points = [f"[{', '.join(map(number, edge if edge[2] else edge[:2]))}]" for edge in outline]
    yield from written_list("polygon_mm", points, remark)


def _comment_of(model: FemModel) -> str:
    return f" ({plain(model.comment)})" if model.comment not in {"", "Add comments here."} else ""
