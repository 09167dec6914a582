"""The ``femfit`` command of the interpreter that runs the tests, whether its environment is activated or not."""

import subprocess
import sys
from pathlib import Path

FEMFIT = str(Path(sys.executable).with_name("femfit"))


def femfit(*arguments, **options):
    """Run the command and keep what it prints."""
    return subprocess.run(
        [FEMFIT, *map(str, arguments)], capture_output=True, text=True, check=False, timeout=180, **options
    )
