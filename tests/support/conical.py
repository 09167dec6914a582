"""A push solenoid with a conical pole, whose rim and cone are turned in one setting; its steel does not saturate."""

from support.small_drawing import DRAWINGS

CONICAL = (DRAWINGS / "conical.toml").read_text(encoding="utf-8")


def moved(change):
    """The drawing of a device whose pole, rim and cone, stands by so many mm elsewhere along z."""
    corners = "[8, 5], [6, 5], [1.6, 0.1111]"
    assert corners in CONICAL
    return CONICAL.replace(corners, f"[8, {5 + change:g}], [6, {5 + change:g}], [1.6, {0.1111 + change:.4f}]")


def at_distances(text, distances):
    """A drawing swept at other distances in mm, as the file has them."""
    before, _, after = text.partition("distance_mm = ")
    return f"{before}distance_mm = {distances}\n{after.partition(chr(10))[2]}"
