"""Drift-free flux and field from a coil's voltage. P. Arpaia et al., Sensors 22 (2022) 182."""
