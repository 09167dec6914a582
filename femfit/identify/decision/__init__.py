"""Which effect is missing, or none."""
