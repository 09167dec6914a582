"""Model files with wrong numbers, lists and keys: read and used, or refused with a word; the interpreter goes on."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from benchmarks.mutants import changed_entry, pick

from femfit import FemfitError, kalman_filter
from femfit.model.json_file import model_of

MODELS = Path(__file__).parents[1] / "golden/inputs/models"
NAMES = ("rig", "rig-F1e", "rig-effects", "bearing", "solenoid", "plunger-effects")


def used(path):
    """What a program does with a model first."""
    model = model_of(path)
    box, n = model.validity, len(model.circuits)
    model.magnetics.force(np.linspace(box.distance_min_m, box.distance_max_m, 3), np.zeros((3, max(n, 1))))
    followed = kalman_filter(model, "ekf")
    middle = 0.5 * (box.distance_min_m + box.distance_max_m)
    state = followed.start([middle, 0.0, *[0.1] * n])
    followed.step(state, np.zeros(n), np.ones(len(followed.process.outputs)))


def try_many(folder, count, seed, use):
    """Read or use damaged models; what is raised that is no error of femfit ends the process."""
    random = np.random.default_rng(seed)
    contents = [(MODELS / f"{name}.json").read_bytes() for name in NAMES]
    path, read = Path(folder) / "model.json", 0
    for _ in range(count):
        path.write_bytes(changed_entry(pick(contents, random), b"", random))
        try:
            use(path)
            read += 1
        except FemfitError:
            pass
    sys.stdout.write(str(read))


@pytest.mark.parametrize(("count", "use"), [(60, "model_of"), pytest.param(300, "used", marks=pytest.mark.nightly)])
def test_damaged_models_are_used_or_refused_and_the_interpreter_goes_on(tmp_path, count, use):
    places = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
    program = f"import sys; sys.path[:0] = {places}; import test_damaged_models as t; t."
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", f"{program}try_many({str(tmp_path)!r}, {count}, 1, t.{use})"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert 0.1 * count < int(done.stdout) < count
