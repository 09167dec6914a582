"""How warm winding, iron and magnet become: losses, a network of the drawing's parts, steady state and time."""
