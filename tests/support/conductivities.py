"""A model whose eddy currents have a drawn conductivity, with what that changes of the impedance."""

from dataclasses import replace

import numpy as np

from femfit.model.coordinate import DistanceCoordinate
from femfit.model.drawn_effect import DrawnEffect
from femfit.model.impedance import impedance_change
from support.eddies import with_eddies

KEY = "materials.core.conductivity_MS_per_m"
STEP = 1e-4


def with_conductivity(model, share):
    """The model with eddy currents whose conducting parts conduct better by a share: resistances go with 1 / sigma."""
    eddied = with_eddies(model)
    return replace(eddied, eddy=replace(eddied.eddy, resistances_ohm=eddied.eddy.resistances_ohm / (1.0 + share)))


def with_drawn_conductivity(model, tolerance=0.1):
    """The model with eddy currents, and its conductivity among the drawing's numbers: slopes by central differences."""
    box = model.validity
    d = np.linspace(box.distance_min_m, box.distance_max_m, 7)
    f = np.geomspace(10.0, 20e3, 34)
    i = np.array([box.current_min_A, box.current_max_A])
    grid = np.meshgrid(d, i, f, indexing="ij")
    larger, smaller = (with_conductivity(model, s).impedance(*grid) for s in (STEP, -STEP))
    slope = (larger - smaller) / (2.0 * STEP)
    change = impedance_change("change", DistanceCoordinate(0.03), d, i, f, slope, share=True)
    drawn = DrawnEffect(KEY, "the conductivity of core", "", 6.0, tolerance, impedance=change)
    return replace(with_eddies(model), drawn=(drawn,))
