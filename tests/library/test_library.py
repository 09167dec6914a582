"""``import femfit``: the public names, what they load, and scripts as users write them."""

import ast
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import femfit
from femfit.core.public import public
from support.actuators import GEOMETRY
from support.command import python

STUB = Path(femfit.__file__).with_name("__init__.pyi")
HEAVY = ("numpy", "pandas", "scipy", "ngsolve", "cvxpy", "matplotlib", "pyvista", "pydantic")


def test_what_editors_see_is_what_is_loaded():
    imported = {
        alias.asname: f"{node.module}:{alias.name}"
        for node in ast.parse(STUB.read_text()).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert imported == femfit.PLACES
    assert set(femfit.__all__) <= set(dir(femfit))


@pytest.mark.parametrize(
    ("name", "given"),
    [
        *((name, [None]) for name in ("read_actuator", "read_sweep", "import_table", "fit_model", "read_model")),
        *((name, [None]) for name in ("kalman_filter", "close_loop", "read_measurement", "integrate_coil")),
        *((name, ["model", None]) for name in ("write_model", "export", "compare", "write_report")),
        ("import_table", [[None]]),
        ("run_sweep", [None, "place"]),
        ("run_sweep", [GEOMETRY / "emaws-rig.toml", None]),
        ("write_report", [None, "place"]),
    ],
)
def test_nothing_in_place_of_a_path_is_refused_by_what_was_given(name, given, levitation_model, tmp_path):
    known = {"model": levitation_model, "place": tmp_path / "page.html"}
    with pytest.raises(femfit.FemfitError, match="NoneType"):
        getattr(femfit, name)(*(known.get(one, one) if isinstance(one, str) else one for one in given))


def test_a_wrong_name_is_answered_with_the_right_ones():
    with pytest.raises(AttributeError, match="read_actuator"):
        femfit.read_drawing  # noqa: B018


@pytest.mark.parametrize(
    ("code", "late"),
    [
        ("import femfit; dir(femfit)", HEAVY),
        ("import femfit.cli.main as m; m.build_app(())", HEAVY),
        ("import femfit.cli.sweeps, femfit.cli.benches", ("pandas",)),  # which load tables when they run
    ],
)
def test_what_is_heavy_loads_late(code, late):
    assert python(f"import sys; {code}; print([name for name in {late} if name in sys.modules])").strip() == "[]"


def test_python_m_femfit_is_the_command():
    done = subprocess.run([sys.executable, "-m", "femfit", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == femfit.__version__


def blas_threads():
    """Of each library; one that was built for a single thread keeps to it."""
    return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]


def test_a_public_function_works_with_one_blas_thread_and_gives_back_the_callers():
    inner = public(blas_threads, "femfit", "inner")
    outer = public(lambda: [*inner(), *blas_threads()], "femfit", "outer")
    with threadpool_limits(2, user_api="blas"):
        before = blas_threads()
        assert 2 in before
        assert set(outer()) == {1}
        assert blas_threads() == before


def test_a_keyword_that_a_function_has_not_is_answered_with_those_that_it_has(levitation_model):
    with pytest.raises(femfit.FemfitError, match="voltage_V") as wrong:
        femfit.simulate(levitation_model, voltage=3)
    assert isinstance(wrong.value, TypeError)
    with pytest.raises(TypeError, match="model"):
        femfit.simulate()


def test_public_functions_are_found_again_by_pickle():
    functions = [getattr(femfit, name) for name in femfit.__all__ if name[0].islower()]
    found = [pickle.loads(pickle.dumps(function)) for function in functions]  # noqa: S301  our own
    assert all(again is function for again, function in zip(found, functions, strict=True))
