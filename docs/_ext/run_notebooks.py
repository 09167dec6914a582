"""Run the notebooks and keep them, with what they show, beside the pages: ``python docs/_ext/run_notebooks.py [NAME]``.

The site is built from these copies, so that a build needs seconds and cannot fail because a machine is slow. Run this
when a notebook changes, or what femfit answers in one: ``tests/notebooks`` says when a copy is no longer its own.
"""

import os
import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).parents[2]
TUTORIAL = ROOT / "docs" / "tutorial"


def run(name: str) -> None:
    """Run a notebook in the folder where it stands, and write it with its outputs beside the pages."""
    path = ROOT / "notebooks" / f"{name}.ipynb"
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=None, resources={"metadata": {"path": str(path.parent)}}).execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)  # times of the clock
    notebook.metadata.get("language_info", {}).pop("version", None)
    nbformat.write(notebook, TUTORIAL / path.name)


if __name__ == "__main__":
    os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    for given in sys.argv[1:] or sorted(path.stem for path in (ROOT / "notebooks").glob("*.ipynb")):
        run(given)
