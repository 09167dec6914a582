"""Actuator files: TOML to frozen dataclasses, checked."""
