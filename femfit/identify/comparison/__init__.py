"""How far a model is from measurements, and where."""
