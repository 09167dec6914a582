"""Fixtures that several rooms share."""

import fcntl
import functools
import os

# Before numpy loads: threads inside the small factorisations of the tests cost more than they save.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

from femfit.device.electrics import Circuit
from femfit.device.mechanics import Mechanics
from femfit.field.sweep import run_sweep
from femfit.model.actuator_model import ActuatorModel
from femfit.model.coordinate import DistanceCoordinate
from femfit.model.hall import HallSensor, HallSpline
from femfit.model.magnetics import CoenergySpline
from femfit.model.validity import Misfit, ValidityBox
from support.actuators import GEOMETRY
from support.expected import Expected
from support.model_kinds import KINDS
from support.splines import REFERENCE_DISTANCE, fitted_spline

LONGEST_FILES = ("test_house.py", "test_notebooks.py", "test_commands.py", "test_site.py")
"""They take from half a minute to two each: begun first, they leave no worker alone at the end."""


def pytest_configure(config):
    """Compiled functions go beside pytest's own cache, not to the user's."""
    os.environ["XDG_CACHE_HOME"] = str(config.rootpath / ".pytest_cache")


def pytest_addoption(parser):
    parser.addoption("--renew", action="store_true", help="write expected results anew; each test that did fails once")


@pytest.fixture(scope="session")
def expected(request):
    return Expected(request.config.getoption("--renew"))


@pytest.fixture(scope="session")
def renew(request):
    """Whether what is got becomes what is expected."""
    return request.config.getoption("--renew")


def pytest_collection_modifyitems(items):
    items.sort(key=lambda item: item.path.name not in LONGEST_FILES)


@pytest.fixture(scope="session")
def made_once(tmp_path_factory):
    """What a function of a path gives, called by one process at a time: it finds what another has made."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def made(name, function):
        with (shared / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            return function(shared / name)

    return made


@pytest.fixture(scope="session")
def rig_sweep(made_once):
    """The table of emaws-rig as drawn, 488 points."""
    rig = GEOMETRY / "emaws-rig.toml"
    return made_once("rig-sweep", lambda place: run_sweep(rig, place, workers=1))  # a process starts in 3 s


def _coenergy(d: np.ndarray, i: np.ndarray) -> np.ndarray:
    """A magnet under a 308-turn coil: F(20 mm, i) = 0.0262 N + 0.088 N/A i, L = 16 mH; falling as they do."""
    decay = np.exp(-d / 0.0166)
    return 4.19e-9 / (3.0 * d**3) + 0.2925 * 0.0166 * decay * i + 0.5 * (0.0162 + 2e-4 * decay) * i**2


def _hall_field(d: np.ndarray, i: np.ndarray) -> np.ndarray:
    """8.7 mT of the magnet at 20 mm, 5 mT/A of the coil."""
    return 8.6e-8 / (d + 0.0015) ** 3 + (0.005 + 1e-4 * np.exp(-d / 0.0166)) * i


@pytest.fixture(scope="session")
def levitation_model() -> ActuatorModel:
    """A rig like the paper's, with a co-energy spline, circuit, motion and Hall sensor (3.2 mV of noise)."""
    currents = np.linspace(0.0, 1.4, 8)
    return ActuatorModel(
        name="test-rig",
        magnetics=CoenergySpline(DistanceCoordinate(REFERENCE_DISTANCE), fitted_spline(_coenergy, currents, 2)),
        validity=ValidityBox.of_currents((0.015, 0.045), (0.0, 1.4)),
        circuits=(Circuit(2.69, 0.5, 3.0),),
        motion=Mechanics(4.35e-3),
        sensor=HallSensor(
            field=HallSpline(DistanceCoordinate(REFERENCE_DISTANCE), fitted_spline(_hall_field, currents, 1)),
            sensitivity_V_per_T=50.0,
            quiescent_V=2.5,
            output_min_V=0.0,
            output_max_V=5.0,
            adc_bits=12,
            noise_V=3.2e-3,
        ),
        misfit=Misfit(1e-5, 4e-5, 5e-4, 2.3e-4, 1e-6, 1e-6, 488, "sweep"),
        sample_time_s=0.5e-3,
        reference_distances_m=(0.022, 0.030, 0.022),
        provenance={"made_by": "tests"},
    )


@pytest.fixture(scope="session")
def model_kind(levitation_model):
    """The models of ``support.model_kinds`` by their names, each made once."""
    return functools.cache(lambda name: KINDS[name](levitation_model))
