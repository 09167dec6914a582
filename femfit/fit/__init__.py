"""Bounded QP: two-stage fit, co-energy fit, ranking of candidates."""
