"""What several tests share: actuators built in code, the place of the reference data."""
