"""Recorded time series as observations: short-window balances of force and voltage instead of open-loop simulation."""
