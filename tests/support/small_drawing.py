"""Small linear drawings with everything that signatures are of: a core, a coil round it, a magnet, a Hall element."""

from pathlib import Path

DRAWINGS = Path(__file__).with_name("drawings")
SMALL, SLEEVED = ((DRAWINGS / f"{name}.toml").read_text(encoding="utf-8") for name in ("small", "sleeved"))
"""The second without sensor; its sleeve has no face in the open air, between core and winding."""
