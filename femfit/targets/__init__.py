"""Packages that run a model without the fitting half of femfit."""
