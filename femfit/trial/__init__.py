"""How often the diagnosis would be right on a device: campaigns on a virtual bench with a hidden error, and counts."""
