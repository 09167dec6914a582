"""Small drawings: with everything that signatures are of, a pot with eddy currents, a conical pole."""

from pathlib import Path

DRAWINGS = Path(__file__).with_name("drawings")


def _text(name):
    return (DRAWINGS / f"{name}.toml").read_text(encoding="utf-8")


SMALL, SLEEVED = _text("small"), _text("sleeved")
"""Core, coil, magnet, Hall element; no sensor, and a sleeve without a face in the open air, in the winding."""

POT, TWO_WINDINGS = _text("eddy-pot"), _text("eddy-pot-two-windings")
"""Solid iron with a magnet beneath its disc, on few elements; two windings side by side, each a circuit."""

CONICAL = _text("conical")
"""A push solenoid with a conical pole, whose rim and cone are turned in one setting; its steel does not saturate."""


def moved(change):
    """The drawing of a device whose pole, rim and cone, stands by so many mm elsewhere along z."""
    corners = "[8, 5], [6, 5], [1.6, 0.1111]"
    assert corners in CONICAL
    return CONICAL.replace(corners, f"[8, {5 + change:g}], [6, {5 + change:g}], [1.6, {0.1111 + change:.4f}]")


def at_distances(text, distances):
    """A drawing swept at other distances in mm, as the file has them."""
    before, _, after = text.partition("distance_mm = ")
    return f"{before}distance_mm = {distances}\n{after.partition(chr(10))[2]}"
