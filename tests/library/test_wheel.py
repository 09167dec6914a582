"""The wheel, installed away from the checkout, does what the checkout does."""

import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

from support.actuators import rig_at

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.nightly


def run(*command, **options):
    words = [str(word) for word in command]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=300, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A fresh environment with the wheel in it; femfit's dependencies are those of the tests."""
    place = tmp_path_factory.mktemp("wheel")
    pip = (sys.executable, "-m", "pip", "-q", "--disable-pip-version-check")
    run(*pip, "wheel", ROOT, "--no-deps", "--no-build-isolation", "-w", place)
    (wheel,) = place.glob("femfit-*.whl")
    venv.create(place / "env", with_pip=False)
    python = place / "env" / "bin" / "python"
    (packages,) = (place / "env").glob("lib/*/site-packages")
    (packages / "tests.pth").write_text(sysconfig.get_path("purelib"))  # a path alone: no editable install comes along
    run(*pip, "--python", python, "install", "--no-deps", "--no-index", wheel)
    return python.parent


@pytest.fixture
def elsewhere(tmp_path):
    """A directory with a small drawing, far from the checkout."""
    (tmp_path / "small.toml").write_text(rig_at("[0, 0.5, 1, 1.4]", "[15, 18, 22, 28, 36, 45]"))
    return {"cwd": tmp_path, "env": {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}}


def test_the_installed_command_goes_from_a_drawing_to_a_model(installed, elsewhere):
    assert "sweep" in run(installed / "femfit", "--help", **elsewhere)
    run(installed / "femfit", "sweep", "small.toml", "-o", "run", "--workers", "1", **elsewhere)
    run(installed / "python", "-m", "femfit", "fit", "run", "--model", "coenergy", "-o", "model.json", **elsewhere)
    code = "import femfit; print(femfit.__file__); print(femfit.read_model('model.json').force(0.022, 0.5))"
    place, force = run(installed / "python", "-c", code, **elsewhere).split()
    assert Path(place).is_relative_to(installed.parent)
    assert 0.01 < float(force) < 0.2


def test_the_wheel_brings_its_data_and_its_types(installed):
    (package,) = installed.parent.glob("lib/*/site-packages/femfit")
    for file in ("py.typed", "__init__.pyi"):
        assert (package / file).is_file()
    sources = {path.relative_to(ROOT / "femfit") for path in (ROOT / "femfit").rglob("*") if path.suffix != ".pyc"}
    shipped = {path.relative_to(package) for path in package.rglob("*")}
    assert {path for path in sources if path.is_file() and "__pycache__" not in path.parts} <= shipped
