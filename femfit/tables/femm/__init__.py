"""FEMM models to actuator files."""
