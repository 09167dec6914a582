"""Checks of a model or of a published parameter set on its own, before any measurement."""
