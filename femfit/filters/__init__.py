"""Kalman filters of a model, and what they can reach. numpy only."""
