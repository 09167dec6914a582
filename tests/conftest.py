"""Fixtures that several rooms share."""

import fcntl
import functools
import gc
import os
import resource

# Before numpy loads: threads inside the small factorisations of the tests cost more than they save.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest

from femfit.field.sweep import run_sweep
from support.actuators import GEOMETRY
from support.expected import Expected
from support.levitation import levitation_rig
from support.model_kinds import KINDS
from support.small_drawing import SMALL

LONGEST_FILES = ("test_house.py", "test_notebooks.py", "test_commands.py", "test_site.py")
"""They take from half a minute to two each: begun first, they leave no worker alone at the end."""


def pytest_configure(config):
    """Compiled functions go beside pytest's own cache, not to the user's.

    Short tests are over before a compiler would pay: without the long ones, filters and compiled code alone compile.
    """
    os.environ["XDG_CACHE_HOME"] = str(config.rootpath / ".pytest_cache")
    if "not nightly" in config.option.markexpr:
        os.environ.setdefault("FEMFIT_COMPILER", "")


def pytest_addoption(parser):
    parser.addoption("--renew", action="store_true", help="write expected results anew; each test that did fails once")


@pytest.fixture(scope="session")
def expected(request):
    return Expected(request.config.getoption("--renew"))


@pytest.fixture(scope="session")
def renew(request):
    return request.config.getoption("--renew")


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """What is imported stays: the garbage collector would look at it for a third of the time, again and again."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


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
    rig = GEOMETRY / "emaws-rig.toml"
    return made_once("rig-sweep", lambda place: run_sweep(rig, place, workers=1))  # a process starts in 3 s


@pytest.fixture(scope="session")
def small_sweep(made_once):
    """A folder with the small drawing, ``small.toml``, and its sweep with signatures, ``run``."""

    def swept(place):
        place.mkdir(exist_ok=True)
        (place / "small.toml").write_text(SMALL)
        run_sweep(place / "small.toml", place / "run", workers=1, signatures=True)
        return place

    return made_once("small-sweep", swept)


@pytest.fixture(scope="session")
def levitation_model():
    return levitation_rig()


@pytest.fixture(scope="session")
def model_kind(levitation_model):
    """The models of ``support.model_kinds`` by their names, each made once."""
    return functools.cache(lambda name: KINDS[name](levitation_model))


@pytest.fixture
def largest_file():
    """Limits how many bytes a file has, as a disk that fills up does."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (limits[1] if size is None else size, limits[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)
