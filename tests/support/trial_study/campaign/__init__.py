"""Measurement campaigns with a sealed key: plan, truth, noise, files. Knows no effect."""
