"""What the benches of the trial really do: field solutions, hysteresis, heat, off-axis magnets. Knows no effect."""
