"""The pool of worker processes."""

import os
import signal
import time

import pytest

from femfit.core.errors import DomainError
from femfit.core.processes import process_pool


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
