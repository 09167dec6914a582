"""What a record over time shows before anything is computed from it: rests, lift-off, and what the driver gave."""
