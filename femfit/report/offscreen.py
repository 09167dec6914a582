"""pyvista without a screen, in a child process.

VTK ends the whole process with a segmentation fault where neither EGL nor OSMesa is there. The child that tries is the
child that draws: what kills it costs one picture, and the report says so.
"""

import os
import pickle
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from femfit.device.parts import Actuator
from femfit.report.field_sample import FieldSample

WINDOWS = ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")
"""Windows of VTK that need no screen."""

VARIABLE = "VTK_DEFAULT_OPENGL_WINDOW"

TIMEOUT_S = 20.0
"""For one window; a picture takes 2 to 4 s, most of it the import of VTK."""


@dataclass(frozen=True)
class OffScreenPicture:
    """What came of drawing.

    Parameters
    ----------
    image : bytes or None
        A PNG file; None where no window works.
    how : str
        With which window, or why not, in plain words.
    """

    image: bytes | None
    how: str


def draw_off_screen(actuator: Actuator, sample: FieldSample, timeout: float = TIMEOUT_S) -> OffScreenPicture:
    """Draw the cut-away in a child process.

    Parameters
    ----------
    timeout : float
        For each window, in s.

    Returns
    -------
    OffScreenPicture
        Of the first window that works. A window that the environment asks for is the only one tried.
    """
    given = os.environ.get(VARIABLE)
    reasons = []
    with tempfile.TemporaryDirectory() as directory:
        task, image = Path(directory) / "task", Path(directory) / "image.png"
        task.write_bytes(pickle.dumps((actuator, sample)))
        for window in (given,) if given else WINDOWS:
            failure = _try(window, task, image, timeout)
            if not failure:
                return OffScreenPicture(image.read_bytes(), f"pyvista, off-screen ({window})")
            reasons.append(f"{window}: {failure}")
    return OffScreenPicture(None, "pyvista cannot draw off-screen here (" + "; ".join(reasons) + ")")


def _try(window: str, task: Path, image: Path, timeout: float) -> str:
    """Empty if there is a picture, else why not."""
    try:
        child = subprocess.run(  # noqa: S603 - this interpreter, this package
            [sys.executable, "-m", "femfit.report.cutaway", str(task), str(image)],
            env=os.environ | {VARIABLE: window},
            capture_output=True,
            timeout=timeout,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"no picture within {timeout:g} s"
    if child.returncode < 0:
        return f"the process was killed by signal {-child.returncode}"
    if child.returncode or not image.is_file():
        return f"the process ended with code {child.returncode} and no picture"
    return ""
