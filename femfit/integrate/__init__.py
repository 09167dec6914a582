"""Drift-free flux and field from a coil's voltage: feed-forward integrators and Kalman filters. numpy only.

References
----------
P. Arpaia et al., Drift-Free Integration in Inductive Magnetic Field Measurements Achieved by Kalman Filtering, Sensors
22 (2022) 182. Equation numbers in this folder are this paper's.
"""
