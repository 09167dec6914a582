"""The experiment of P. Arpaia et al., Sensors 22 (2022) 182, again: its magnet, coil and tables."""
