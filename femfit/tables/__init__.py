"""What users have elsewhere: tables and FEMM models, to sweep tables and actuator files."""
