"""Damaged drawings and model files: ``python tests/benchmarks/mutants.py --count 50000 --seed 1``.

Each is read in this process and used, or refused by an error of femfit. Printed are other exceptions, what takes
longer than ``SECONDS``, and what was read although it means nothing. ``--messages FILE`` writes the messages, to be
read by eye.
"""

import argparse
import json
import math
import signal
import sys
import tomllib
import traceback
import warnings
from collections import Counter
from dataclasses import asdict
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from model.test_damaged_models import damaged

from femfit.core.errors import ActuatorFileError, FemfitError
from femfit.core.files import json_ready
from femfit.device.load import actuator_from_record, actuator_from_toml
from femfit.device.rewrite import variants_from_toml
from femfit.model.json_file import model_from_dict, model_to_dict

ROOT = Path(__file__).parents[2]
SECONDS, MODEL_EACH = 20, 20
FOLDERS = ("geometry", "femfit/device/examples", "docs/reference", "tests/device/drawings", "tests/support/drawings")
DRAWINGS = [path for folder in FOLDERS for path in sorted((ROOT / folder).glob("*.toml"))]
MODELS = sorted((ROOT / "tests/golden/inputs/models").glob("*.json"))
TOKENS = [
    *("nan", "inf", "-inf", "0", "-1", "2.5", "1e308", "-1e308", "1e-320", "1" * 400, "true", '"text"', "'+z'", '""'),
    *("1979-05-27", "[]", "{}", "[[]]", "[0, 5.5]", "[[0, 0]]", "[[0, 0], [1, 0], [0, 1]]", "[1, 2, 3]", "{ a = 1 }"),
    *("{ start = 0, stop = 1e300, step = 1e-300 }", "{ start = 0, stop = 2, step = 1 }", "[1, 'x']", "'\\u001b[31m'"),
]


def mangled(word, random):
    """A word with a letter dropped, doubled, changed or in capitals."""
    k = random.integers(len(word)) if word else 0
    changes = word[:k] + word[k + 1 :], word[:k] + word[k : k + 1] + word[k:], f"{word[:k]}x{word[k + 1 :]}"
    return (*changes, word.upper())[random.integers(4)]


def damaged_text(text, others, random):
    """A drawing's text with up to two of its lines altered, misplaced or gone."""
    lines = text.splitlines()
    for _ in range(random.integers(1, 3)):
        n = random.integers(len(lines))
        key, equals, value = lines[n].partition(" = ")
        kind = random.integers(8)
        if kind == 0:
            lines[n] = ""
        elif kind == 1:
            lines.insert(random.integers(len(lines)), lines[n])
        elif kind == 2:
            lines.insert(n, others[random.integers(len(others))])
        elif kind == 3 or not equals:
            lines[n] = mangled(lines[n], random)
        elif kind == 4:
            lines[n] = mangled(key, random) + equals + value
        elif kind == 5:
            factor = random.choice([-1.0, 0.1, 0.9, 1.1, 10.0, 1e3])
            words = [str(factor * float(word)) if word.isdigit() else word for word in value.split(" ")]
            lines[n] = key + equals + " ".join(words)
        else:
            lines[n] = key + equals + TOKENS[random.integers(len(TOKENS))]
    return "\n".join(lines)


def drawing_read(text, directory):
    """What a drawing becomes; what is wrong with that is an AssertionError."""
    actuator = actuator_from_toml(text, "mutant", directory)
    sweep = actuator.sweep
    numbers = [*sweep.currents_A, *sweep.distances_m, *(coil.resistance_ohm for coil in actuator.coils)]
    assert all(map(math.isfinite, numbers)), "numbers that are not finite"
    assert list(sweep.distances_m) == sorted({*sweep.distances_m}), "distances that do not ascend"
    assert str(actuator)
    record = json.loads(json.dumps(json_ready(asdict(actuator)), allow_nan=False))
    assert actuator_from_record(record, "record") == actuator, "another actuator from its record"
    if "parameters" in tomllib.loads(text)["sweep"]:
        variants_from_toml(text, "mutant", directory)
    return "read"


def model_read(document):
    """What a model file becomes, as :func:`drawing_read`."""
    model = model_from_dict(document, "mutant")
    d, i = model.validity.grid(3, 3, several=2)
    assert np.isfinite(model.magnetics.force(d, i)).all(), "forces that are not finite"
    again = json.loads(json.dumps(model_to_dict(model), allow_nan=False))
    assert json.dumps(model_to_dict(model_from_dict(again, "again"))) == json.dumps(again), "another model when written"
    return "read"


def stopped(*_):
    raise TimeoutError(f"longer than {SECONDS} s")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--count",
        type=int,
        default=2000,
        help="mutants, every twentieth one a model file, which takes as long as twenty drawings",
    )
    parser.add_argument("--seed", type=int, default=1, help="of the first mutant; each has the next one")
    parser.add_argument("--drawings", action="store_true", help="leave the model files out")
    parser.add_argument("--messages", type=Path, help="a file for the message of each mutant")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGALRM, stopped)
    texts = [path.read_text(encoding="utf-8") for path in DRAWINGS]
    others = [line for text in texts for line in text.splitlines() if line]
    documents = [json.loads(path.read_text(encoding="utf-8")) for path in MODELS]
    outcomes, faults, messages = Counter(), Counter(), []
    for number in range(options.seed, options.seed + options.count):
        if options.drawings and not number % MODEL_EACH:
            continue
        random = np.random.default_rng(number)
        try:
            signal.alarm(SECONDS)
            if number % MODEL_EACH:
                k = random.integers(len(texts))
                text = damaged_text(texts[k], others, random)
                outcome = drawing_read(text, DRAWINGS[k].parent)
            else:
                outcome = model_read(damaged(documents[random.integers(len(documents))], random))
        except FemfitError as error:
            outcome = type(error).__name__
            problems = error.problems if isinstance(error, ActuatorFileError) else [str(error)]
            messages += [f"{number}: {problem}" for problem in problems]
        except Exception as error:  # noqa: BLE001  this is what is looked for
            outcome = "wrong"
            place = traceback.extract_tb(error.__traceback__)[-1]
            fault = f"{type(error).__name__} {str(error)[:80]} at {Path(place.filename).name}:{place.lineno}"
            faults[fault] += 1
            if faults[fault] <= 2:
                print(f"{number}: {fault}", flush=True)
        finally:
            signal.alarm(0)
        outcomes["drawing" if number % MODEL_EACH else "model", outcome] += 1
    for (kind, outcome), count in sorted(outcomes.items()):
        print(f"{kind} {outcome}: {count:,}")
    for fault, count in faults.most_common():
        print(f"{count} times {fault}")
    if options.messages:
        options.messages.write_text("\n".join(messages) + "\n", encoding="utf-8")
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
