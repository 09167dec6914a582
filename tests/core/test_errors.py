"""The error tree: each of ours is also a builtin, and survives the way back from a worker process."""

import gc
import os
import signal
import time
from weakref import ref

import numpy as np
import pytest

from femfit.core import errors
from femfit.core.errors import DomainError
from femfit.core.processes import process_pool
from femfit.core.results import remembered

TREE = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, errors.FemfitError)]


@pytest.mark.parametrize(
    "kind", sorted({*TREE} - {errors.FemfitError}, key=lambda kind: kind.__name__), ids=lambda kind: kind.__name__
)
def test_each_error_is_also_a_builtin(kind):
    builtins = {base for base in kind.__mro__ if base.__module__ == "builtins"}
    assert builtins - {object, BaseException, Exception}
    assert kind.__name__ in errors.__doc__


@pytest.mark.parametrize("workers", [0, -1, 1.5, "all"])
def test_what_is_no_number_of_workers_is_refused_with_what_was_given(workers):
    with pytest.raises(DomainError, match=str(workers)):
        process_pool(workers)


def test_a_worker_does_not_hear_the_ctrl_c_of_a_terminal_which_goes_to_all():
    with process_pool(1) as pool:
        assert signal.SIGINT in pool.submit(signal.pthread_sigmask, signal.SIG_BLOCK, ()).result()
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_a_block_that_is_interrupted_waits_for_no_worker():
    begin = time.monotonic()

    def interrupted():
        with process_pool(1) as pool:
            pool.submit(os.getpid).result()
            pool.submit(time.sleep, 60.0)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert time.monotonic() - begin < 50.0


def test_what_is_remembered_is_worked_out_once_cannot_be_written_to_and_keeps_no_object_alive():
    calls = []
    result_of = remembered(lambda coil: calls.append(ref(coil)) or np.zeros(2))
    first, second = (type("Coil", (), {})() for _ in range(2))
    assert result_of(first) is result_of(first) is not result_of(second)
    with pytest.raises(ValueError, match="read-only"):
        result_of(first)[0] = 1.0
    del first
    gc.collect()
    assert [kept() is None for kept in calls] == [True, False]
