"""Models and records that the tests of identification share, each made once."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from femfit.model.bspline import DistanceCoordinate
from femfit.model.magnetics import Coefficient, CoenergySpline, LawMagnetics
from femfit.model.validity import ValidityBox
from support.closed_loop import closed_loop, recorded
from support.levitation import REFERENCE_DISTANCE, fitted_spline


@pytest.fixture(scope="session")
def model(levitation_model):
    """With a controller half as fast, so that the loops take half as long."""
    return replace(levitation_model, sample_time_s=1e-3)


@pytest.fixture(scope="session")
def loops(model, made_once):
    """Twelve closed loops of 2.5 s without any error but the Hall element's noise."""

    def solved(file):
        if not file.is_file():
            closed_loop(model, runs=12, seconds=2.5, seed=7).to_pickle(file)
        return pd.read_pickle(file)  # noqa: S301  our own

    return made_once("loops.pkl", solved)


@pytest.fixture(scope="session")
def clean_record(loops):
    """Two of them as instruments of 30 um and 4 mA record them."""
    return recorded(loops, runs=(1, 2), distance_m=3e-5, current_A=4e-3)


def pot_of(model, strength, *box):
    """F = c (i / d)^2, without a magnet."""
    law = LawMagnetics("F1e", (Coefficient("d^-2", 2, strength, "N m^2 / A^2"),), {}, 0.03)
    return replace(model, magnetics=law, validity=ValidityBox.of_currents(box[:2], box[2:]), sensor=None)


@pytest.fixture(scope="session")
def pot(levitation_model):
    """A push solenoid of linear iron whose force falls from 36 N at 0.5 mm to 0.3 N at 5.5 mm."""
    return pot_of(levitation_model, 2.2e-6, 0.5e-3, 5.5e-3, 0.5, 2.0)


@pytest.fixture(scope="session")
def strong_pot(levitation_model):
    """A pot and a plate, between 0.6 and 6 mm."""
    return pot_of(levitation_model, 2e-5, 0.6e-3, 6e-3, 0.0, 2.0)


@pytest.fixture(scope="session")
def solenoid(levitation_model):
    """A coil that pulls soft iron: on force alone a wrong force scale is a wrong current scale, for F goes with i^2."""

    def coenergy(d, i):
        return 0.5 * (0.016 + 0.05 * np.exp(-d / 0.01)) * i**2

    spline = fitted_spline(coenergy, np.linspace(0.0, 1.4, 8), 2)
    return replace(
        levitation_model, magnetics=CoenergySpline(DistanceCoordinate(REFERENCE_DISTANCE), spline), sensor=None
    )
