"""The ``femfit`` command, in this process or in one of its own."""

import contextlib
import io
import os
import subprocess
import sys
from pathlib import Path
from unittest import mock

from femfit.cli.main import main

FEMFIT = str(Path(sys.executable).with_name("femfit"))
"""Of the interpreter that runs the tests, whether its environment is activated or not."""


def femfit(*arguments, cwd=None):
    """Run the command in this process, which saves the imports of one of its own, and keep what it prints."""
    words = ["femfit", *map(str, arguments)]
    out, err, home = io.StringIO(), io.StringIO(), Path.cwd()
    silent = contextlib.redirect_stdout(out), contextlib.redirect_stderr(err)
    with silent[0], silent[1], mock.patch.object(sys, "argv", words), mock.patch.dict(os.environ):
        os.chdir(cwd or home)
        try:
            main()
            code = 0
        except SystemExit as stop:
            code = stop.code or 0
        finally:
            os.chdir(home)
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())


def worked(*arguments, **options):
    """Run the command, which must not fail."""
    done = femfit(*arguments, **options)
    assert done.returncode == 0, done.stderr
    return done


def python(code, **options):
    """What code prints in an interpreter of its own, which must not fail."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


def separate_femfit(*arguments, **options):
    """Run the command in a process of its own, as a shell would."""
    words = [FEMFIT, *map(str, arguments)]
    return subprocess.run(words, capture_output=True, text=True, check=False, timeout=180, **options)
