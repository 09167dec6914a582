"""Files of every kind with a few changes: read as what they say, or refused by their name, and never anything else.

``tests/benchmarks/mutants.py`` tries very many more of them.
"""

import signal

import pytest
from benchmarks import mutants

TARGETS = (
    *("drawing", "curve", "bench", "record", "impedance", "sidecar", "coil", "raw", "foreign", "table", "inductance"),
    *("fem", "sweep", "journal", "parquet", "tdms", "xlsx", "wav"),
)


CONTAINERS = ("parquet", "tdms", "xlsx", "wav")


@pytest.fixture(scope="module")
def targets(tmp_path_factory):
    handler = signal.signal(signal.SIGALRM, mutants.stopped)
    yield mutants.targets(tmp_path_factory.mktemp("seeds"))
    signal.signal(signal.SIGALRM, handler)


@pytest.mark.parametrize("name", TARGETS)
def test_a_damaged_file_is_read_or_refused(targets, name, tmp_path):
    mutant = mutants.mutants_of(targets[name], tmp_path)
    for number in range(4 * max(1, round(targets[name].share))):
        result, words, change = mutant(number)
        assert result in {"accepted", "refused"}, f"{number}: {words}\n{change}"
        assert result == "accepted" or name not in CONTAINERS or change.partition(",")[0] in words
