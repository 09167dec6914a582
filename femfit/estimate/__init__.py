"""Kalman filters of a model, what they can reach, and what they make of a record over time."""
