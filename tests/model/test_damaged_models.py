"""Model files with wrong numbers, lists and keys: read and used, or refused with a word; the interpreter goes on."""

import json
import subprocess
import sys
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest

from femfit.core.errors import FemfitError
from femfit.estimate.kalman_filter import kalman_filter
from femfit.model.json_file import model_of

MODELS = Path(__file__).parents[1] / "golden/inputs/models"
NAMES = ("rig", "rig-F1e", "rig-effects", "bearing", "solenoid", "plunger-effects")
STRANGE = (np.nan, np.inf, 0, -1, 1e308, 1e-308, 2**70, 0.5, 1e6, "", "x", None, True, [], {}, [1.0, 2.0], [[1.0]])


def places(value, path=()):
    """The way to every key and entry."""
    if isinstance(value, dict | list):
        for key, entry in value.items() if isinstance(value, dict) else enumerate(value):
            yield (*path, key)
            yield from places(entry, (*path, key))


def damaged(document, random):
    """One place of a document altered, or left out."""
    document = deepcopy(document)
    ways = list(places(document))
    *above, last = ways[random.integers(len(ways))]
    holder = document
    for key in above:
        holder = holder[key]
    kind = random.integers(4)
    if kind == 0:
        del holder[last]
    elif kind == 1 and isinstance(holder[last], float):
        holder[last] *= random.choice([-1.0, 0.0, 1e-3, 1e3, 1e12])
    elif kind == 2 and isinstance(holder, list):
        holder.append(holder[last])
    else:
        holder[last] = STRANGE[random.integers(len(STRANGE))]
    return document


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
    documents = [json.loads((MODELS / f"{name}.json").read_text(encoding="utf-8")) for name in NAMES]
    path, read = Path(folder) / "model.json", 0
    for _ in range(count):
        path.write_text(json.dumps(damaged(documents[random.integers(len(documents))], random)), encoding="utf-8")
        try:
            use(path)
            read += 1
        except FemfitError:
            pass
    sys.stdout.write(str(read))


@pytest.mark.parametrize(("count", "use"), [(60, "model_of"), pytest.param(300, "used", marks=pytest.mark.nightly)])
def test_damaged_models_are_used_or_refused_and_the_interpreter_goes_on(tmp_path, count, use):
    program = f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); import test_damaged_models as t; t."
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", f"{program}try_many({str(tmp_path)!r}, {count}, 1, t.{use})"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert 0.1 * count < int(done.stdout) < count
