"""The outline of a part as the actuator file gives it."""

from dataclasses import dataclass

from femfit.device.keys import LENGTH, Record, key

_ANY = LENGTH | {"kind": "length"}


@dataclass(frozen=True)
class OutlineEntry(Record):
    """A box (r_mm and z_mm), a polygon with arcs (polygon_mm) or a circle (circle_mm)."""

    r_mm: tuple[float, float] | None = key("[inner, outer] radius in mm", None, **_ANY)
    z_mm: tuple[float, float] | None = key("[lower, upper] height in mm", None, **_ANY)
    polygon_mm: tuple[tuple[float, ...], ...] | None = key(
        "at least three corners [[r, z], ...] in mm; a third number is the angle in degrees of an arc to the next "
        "corner, positive counter-clockwise",
        None,
        count=((2, 1000), (2, 3)),
        **_ANY,
    )
    circle_mm: tuple[float, float, float] | None = key(
        "[r, z, radius]: a ball where r is 0, a ring with a round section elsewhere", None, **_ANY
    )
