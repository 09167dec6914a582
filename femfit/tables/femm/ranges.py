"""Axes for a sweep of an imported model that its drawing leaves room for."""

from shapely import unary_union

from femfit.device.checks import CONTACT, swept
from femfit.tables.femm.found import FemDevice
from femfit.tables.femm.movers import outline_of

STEPS_MM = (20.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01)
"""Ways that are tried from the file's own distance, the longest first; none beyond the moving part's own size."""

POINTS = 10
"""Steps of the distances that are offered."""


def offered_axes(device: FemDevice) -> str:
    """Options for a sweep around the file's own point in which nothing collides."""
    axes = []
    nearer, farther = (_free_way(device, sign) for sign in (-1.0, 1.0))
    drawn = device.frame.distance_mm
    if nearer + farther > 0:
        start, stop = round(drawn - nearer, 6), round(drawn + farther, 6)
        axes.append(f"--distance-mm={start:.9g}:{stop:.9g}:{round((stop - start) / POINTS, 7):.9g}")
    if device.windings:
        current = max(abs(device.frame.current(winding)) for winding in device.windings) or 1.0
        axes.append(f"--current-A={','.join(f'{share * current:.6g}' for share in (0.0, 0.25, 0.5, 0.75, 1.0))}")
    return " ".join(axes)


def _free_way(device: FemDevice, sign: float) -> float:
    """How far the moving part can go from where it stands, nearer (-1) or farther (+1); 0 for less than 0.01 mm."""
    fixed = outline_of(device.bodies.standing)
    moving = [piece.polygon for piece in device.bodies.mover]
    _, low, radius, high = outline_of(device.bodies.mover).bounds
    for way in (way for way in STEPS_MM if way <= max(high - low, 2.0 * radius)):
        shift = sign * device.frame.up * way
        track = unary_union([swept(polygon, min(0.0, shift), max(0.0, shift)) for polygon in moving])
        if track.distance(fixed) > 2 * CONTACT:
            return way
    return 0.0
