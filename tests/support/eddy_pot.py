"""A pot of solid iron with a magnet beneath its disc: everything that induces currents, on few elements."""

from support.small_drawing import DRAWINGS

POT = (DRAWINGS / "eddy-pot.toml").read_text(encoding="utf-8")
TWO_WINDINGS, IN_SERIES = (
    (DRAWINGS / f"eddy-pot-{wound}.toml").read_text(encoding="utf-8") for wound in ("two-windings", "in-series")
)
"""The same with two windings side by side in place of its one, each a circuit of its own, or both in one."""
