"""A command ends on SIGTERM and Ctrl-C, also where Python cannot interrupt it."""

import signal
import subprocess
import sys

import pytest

from femfit.cli.signals import PATIENCE

IN_C = """
import sys, threading, ctypes, signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background jobs begin with it ignored
from femfit.cli import main
def app():
    def command(*_, **__):
        print("in C", flush=True)
        {wait}
    return command
main.build_app = app
main.main()
"""
# A mutex locked twice stands for the mesher: C code without the interpreter's lock, which takes
# up its wait again after a signal
STUCK = (
    "libc = ctypes.CDLL(None); lock = ctypes.create_string_buffer(64); [libc.pthread_mutex_lock(lock) for _ in '12']"
)


@pytest.mark.parametrize(("number", "word"), [(signal.SIGTERM, "ended by SIGTERM"), (signal.SIGINT, "interrupted")])
@pytest.mark.parametrize("wait", [STUCK, "import time; time.sleep(60)"], ids=["in C", "in Python"])
def test_a_signal_ends_a_command_with_its_own_code_and_words(wait, number, word):
    child = subprocess.Popen(
        [sys.executable, "-c", IN_C.format(wait=wait)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert child.stdout.readline() == "in C\n"
        child.send_signal(number)
        _, said = child.communicate(timeout=PATIENCE + 60.0)  # a busy machine
    finally:
        child.kill()
    assert child.returncode == 128 + number
    assert said == f"femfit: {word}; what was finished is kept\n"
