"""The noise of a bench: readings, runs and mounts."""
