"""An imported FEMM model as the text of an actuator file, with a comment for everything that it did not hold."""

import json
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from decimal import Decimal
from itertools import pairwise

from femfit.tables.femm.frame import FemFrame
from femfit.tables.femm.model import FemModel
from femfit.tables.femm.options import FemOptions
from femfit.tables.femm.parts import FemBodies, FemPart, simple_outlines
from femfit.tables.femm.winding import FemWinding, FemWire

MAGNET_DENSITY, STEEL_DENSITY = 7.5, 7.85
"""Sintered NdFeB and low-carbon steel in g/cm^3: makers' data sheets agree to 1 %."""


EXACT = 17
"""Digits that print a double without loss: the sweep must hold the file's own point."""


def actuator_toml(
    model: FemModel,
    bodies: FemBodies,
    winding: FemWinding,
    wire: FemWire,
    frame: FemFrame,
    options: FemOptions,
    name: str,
) -> str:
    """The text of an actuator file."""
    taken: set[str] = {"air", "coil"}
    currents = own_point_added(options.currents_A, frame.current_sign * winding.circuit.current_A + 0.0)
    lines = [
        f"# Imported from the FEMM model {_plain(model.source)}{_comment_of(model)}.",
        "# Lengths in mm, cylindrical (r, z); the electromagnet's face, from which distances are counted, is z = 0 and",
        "# z grows towards the moving part, which is drawn at distance 0.",
        f"# The file's z (in {model.unit} there) is {_number(frame.face_mm)} mm {'+' if frame.up > 0 else '-'} this z.",
        f"# Its own point: {_number(frame.distance_mm)} mm, {_number(winding.circuit.current_A)} A{_signs(frame)}.",
        "",
        "schema = 1",
        f"name = {_string(name)}",
        f"description = {_string(f'From the FEMM model {_plain(model.source)}')}",
        *_materials([*bodies.fixed, *bodies.moving]),
        *(line for part in bodies.fixed for line in _regions(part, "electromagnet", frame, taken)),
        *_coil(winding, wire, frame),
        "",
        "[moving]",
        *_mass(bodies.moving, options),
        *(line for part in bodies.moving for line in _regions(part, "moving", frame, taken)),
        *_supply(wire, currents),
        "",
        "[sweep] # holds the file's own point",
        f"current_A = {_axis(currents)}",
        f"distance_mm = {_axis(own_point_added(options.distances_mm, frame.distance_mm))}",
    ]
    return "\n".join(lines) + "\n"


def own_point_added(axis: Sequence[float], own: float) -> list[float]:
    """An axis with the file's own value in its place."""
    return sorted([*(value for value in axis if not math.isclose(value, own, rel_tol=1e-9, abs_tol=1e-9)), own])


def _signs(frame: FemFrame) -> str:
    current = "; current and flux linkage have the opposite sign here" if frame.current_sign < 0 else ""
    return current + ("; every field has the opposite sign here" if frame.field_sign < 0 else "")


def _materials(parts: Iterable[FemPart]) -> Iterator[str]:
    for material in dict.fromkeys(part.material for part in parts):
        yield from ("", f"[materials.{_string(material.name)}]")
        if material.curve:
            for key, values in zip(("B_T", "H_A_per_m"), zip(*material.rising_curve, strict=True), strict=True):
                yield from _list(key, [_number(value, EXACT) for value in values], "")
            continue
        yield f"relative_permeability = {_number(material.mu_y)}"
        if material.coercivity:
            yield f"remanence_T = {_number(material.remanence)} # mu_0 mu_r H_c of {abs(material.coercivity):.6g} A/m"


def _regions(part: FemPart, body: str, frame: FemFrame, taken: set[str]) -> Iterator[str]:
    outlines = simple_outlines(frame.placed(part.polygon, moving=body == "moving"))
    for outline in outlines:
        yield from ("", f"[{body}.regions.{_free_name(part.material.name, taken)}]")
        cut = f"; a closed ring, cut into {len(outlines)} pieces" if len(outlines) > 1 else ""
        yield f"material = {_string(part.material.name)} # {_plain(_origin(part))}{cut}"
        if part.sign:
            yield f'magnetization = "{"+" if part.sign * frame.field_sign > 0 else "-"}z"'
        yield from _outline(outline)


def _origin(part: FemPart) -> str:
    return "; ".join(f"{label.place}, group {label.group}" for label in part.labels)


def _coil(winding: FemWinding, wire: FemWire, frame: FemFrame) -> Iterator[str]:
    yield from ("", "[coil]")
    outlines = simple_outlines(frame.placed(winding.polygon, moving=False))
    yield from _outline(outlines[0], f"circuit {winding.circuit.name!r}: {'; '.join(winding.names)}")
    yield f"turns = {_number(abs(winding.turns))}"
    if wire.diameter_mm is not None:
        yield f"wire_diameter_mm = {_number(wire.diameter_mm)} # {_plain(wire.diameter_origin)}"
    if wire.resistance_origin:
        yield f"resistance_ohm = {_number(wire.resistance_ohm, 6)} # {_plain(wire.resistance_origin)}"


def _mass(parts: Sequence[FemPart], options: FemOptions) -> Iterator[str]:
    if options.mass_g is not None:
        yield f"mass_g = {_number(options.mass_g)}"
        return
    weights = []
    for part in parts:
        density = options.density_g_per_cm3 or (MAGNET_DENSITY if part.sign else STEEL_DENSITY)
        weights.append((density, part.volume_mm3 * 1e-3 if part.material.magnetic else 0.0))
    mass = sum(density * volume for density, volume in weights)
    shown = " + ".join(f"{volume:.5g} cm^3 x {density:g} g/cm^3" for density, volume in weights if volume)
    origin = "" if options.density_g_per_cm3 else "ASSUMED density: "
    yield f"mass_g = {_number(mass, 5)} # {origin}{shown}; weigh the body and correct it"


def _supply(wire: FemWire, currents: Sequence[float]) -> Iterator[str]:
    low, high = (wire.resistance_ohm * bound for bound in (min(0.0, *currents), max(0.0, *currents)))
    yield from ("", "[supply] # ASSUMED: what the winding needs for the currents below; the file has no driver")
    yield f"voltage_min_V = {_number(low, 3)}"
    yield f"voltage_max_V = {_number(high if high > low else wire.resistance_ohm, 3)}"


def _outline(corners: Sequence[tuple[float, float]], comment: str = "") -> Iterator[str]:
    remark = f" # {_plain(comment)}" if comment else ""
    radii, heights = ({point[axis] for point in corners} for axis in (0, 1))
    if len(corners) == 4 and len(radii) == 2 and len(heights) == 2:
        yield f"r_mm = [{_number(min(radii))}, {_number(max(radii))}]{remark}"
        yield f"z_mm = [{_number(min(heights))}, {_number(max(heights))}]"
        return
    points = [f"[{_number(r)}, {_number(z)}]" for r, z in corners]
    yield from _list("polygon_mm", points, remark)


def _list(key: str, items: Sequence[str], remark: str) -> Iterator[str]:
    if len(items) <= 6:
        yield f"{key} = [{', '.join(items)}]{remark}"
        return
    yield f"{key} = [{remark}"
    yield from (f"  {', '.join(items[k : k + 6])}," for k in range(0, len(items), 6))
    yield "]"


def _axis(values: Sequence[float]) -> str:
    exact = [Decimal(repr(float(value))) for value in values]
    steps = {after - before for before, after in pairwise(exact)}
    if len(values) > 3 and len(steps) == 1:
        start, stop, step = (_number(value, EXACT) for value in (values[0], values[-1], float(steps.pop())))
        return f"{{ start = {start}, stop = {stop}, step = {step} }}"
    return f"[{', '.join(_number(value, EXACT) for value in values)}]"


def _number(value: float, digits: int = 12) -> str:
    """The shortest text of a number with so many significant digits; whole numbers without a point."""
    rounded = float(f"{value:.{digits}g}") + 0.0
    return str(int(rounded)) if rounded.is_integer() and abs(rounded) < 1e15 else repr(rounded)


def _free_name(name: str, taken: set[str]) -> str:
    """A region's name from a block's: letters, digits, - and _, beginning with a letter, not yet taken."""
    stem = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")[:50]
    stem = stem if re.match(r"[a-z]", stem) else f"part_{stem}".rstrip("_")
    free = next(
        candidate for n in range(1, len(taken) + 2) if (candidate := stem if n == 1 else f"{stem}_{n}") not in taken
    )
    taken.add(free)
    return free


def _string(text: str) -> str:
    """A TOML basic string."""
    return json.dumps(text, ensure_ascii=False)


def _plain(text: str) -> str:
    """On one line of a comment."""
    return "".join(character if character.isprintable() else " " for character in text)


def _comment_of(model: FemModel) -> str:
    return f" ({_plain(model.comment)})" if model.comment not in {"", "Add comments here."} else ""
