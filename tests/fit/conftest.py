"""Sweeps and fits that several files of this room judge, each made once."""

from functools import cache

import numpy as np
import pytest

from femfit.fit.build import fit_model
from femfit.tables.sweep_table import SweepTable
from support.sweeps import full_table


@pytest.fixture(scope="session")
def closed_form_fit():
    """The co-energy of the closed form of a levitation rig, 488 points."""
    return fit_model(full_table())


@pytest.fixture(scope="session")
def fit_of_circuit():
    """Fit a saturating circuit over a grid of currents in A and distances in m, without some of its columns."""

    @cache
    def fitted(device, currents, distances, *without):
        table = device.table(np.array(currents), np.array(distances))
        return fit_model(SweepTable(table.rows.drop(columns=list(without)), table.manifest))

    return lambda device, currents, distances, *without: fitted(device, tuple(currents), tuple(distances), *without)
