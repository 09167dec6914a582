"""SIGTERM and Ctrl-C end a command wherever it is, in the mesher and in a factorisation too.

Python hands a signal on when the main thread comes back from C, which may be never where a drawing takes the mesher
hours. So a second thread reads the signals, and ends the process where the first one has not heard of one in time.
"""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

PATIENCE = 2.0
"""Seconds that the main thread has to come back from C. Chosen: nobody waits longer before the next Ctrl-C."""


class EndedError(BaseException):
    """SIGTERM: not an Exception, so that nothing on the way takes it for an error of its own."""


WORDS = {
    signal.SIGTERM: "ended by SIGTERM; what was finished is kept",
    signal.SIGINT: "interrupted; what was finished is kept",
}


@contextmanager
def ending_on_signals() -> Iterator[None]:
    """Raise EndedError on SIGTERM and KeyboardInterrupt on Ctrl-C, or end the process where nothing can be raised.

    A Ctrl-C that the shell has this process ignore stays ignored. Only the main thread has signals; in another one
    nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    heard = threading.Event()

    def end(*_: object) -> None:
        heard.set()
        raise EndedError

    def interrupt(*_: object) -> None:
        heard.set()
        raise KeyboardInterrupt

    before = {signal.SIGTERM: signal.signal(signal.SIGTERM, end)}
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        before[signal.SIGINT] = signal.signal(signal.SIGINT, interrupt)
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    woken = signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
    watcher = threading.Thread(target=_watch, args=(reader, heard, set(before)), daemon=True)
    watcher.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(woken)
        for number, handler in before.items():
            signal.signal(number, handler)
        os.close(writer)  # the watcher reads the end
        watcher.join(PATIENCE)


def _watch(reader: int, heard: threading.Event, numbers: set[signal.Signals]) -> None:
    """End the process on a signal that the main thread does not hear of."""
    while number := os.read(reader, 1):
        if number[0] in numbers and not heard.wait(PATIENCE):
            os.write(2, f"femfit: {WORDS[signal.Signals(number[0])]}\n".encode())
            os._exit(128 + number[0])
        heard.clear()
    os.close(reader)
