"""What no effect of the catalogue explains, learnt as a small energy-consistent correction."""
