"""A solenoid and a voice coil whose benches and records are made by other physics than the catalogue's."""
