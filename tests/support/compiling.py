"""Functions that are compiled at once, where there is a compiler."""

import shutil
import time

import pytest

from femfit.core import compiled
from femfit.core.compiled import Compilation

needs_compiler = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="no C compiler on this machine"
)


def waited_for(compilation, after=Compilation.after):
    """Its library."""
    until = time.monotonic() + 60.0
    while (library := after(compilation, 100)) is None and not compilation._over and time.monotonic() < until:
        time.sleep(0.01)
    return library


def compile_at_once(monkeypatch, folder):
    """From now on every function that is called; a list of the libraries that ran."""
    libraries = []

    def after(compilation, _points):
        if compilation._library is None:  # of a test before, which did without a compiler, too
            compilation._over, compilation._work = False, None
        libraries.append(waited_for(compilation))
        return libraries[-1]

    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    monkeypatch.delenv("FEMFIT_COMPILER", raising=False)
    monkeypatch.setattr(compiled, "OFTEN", 100)
    monkeypatch.setattr(Compilation, "after", after)
    return libraries
