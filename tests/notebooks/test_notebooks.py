"""Every notebook runs from top to bottom, and none keeps outputs in git."""

import shutil
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
SPARSE = {"distance_mm = { start = 15, stop = 45, step = 0.5 }": "distance_mm = { start = 15, stop = 45, step = 1 }"}
ROUGH = "\n[solver]\ntolerance = 0.01\n"


@pytest.fixture
def workplace(request, tmp_path):
    """A project's notebooks, drawings and data; where the sweeps' steps and accuracy do not matter, quicker ones."""
    for name in ("data", "geometry", "notebooks"):
        shutil.copytree(ROOT / name, tmp_path / name)
    if request.getfixturevalue("path").stem == "bench_disagrees":
        for name, changes in (("emaws-rig", SPARSE), ("emaws-as-built", {})):
            drawing = tmp_path / "geometry" / f"{name}.toml"
            text = drawing.read_text()
            for old, new in changes.items():
                assert old in text
                text = text.replace(old, new)
            drawing.write_text(text + ROUGH)
    return tmp_path


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(path, workplace):
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(workplace / "notebooks")}}).execute()
    shown = [output for cell in notebook.cells for output in cell.get("outputs", []) if "data" in output]
    assert any("image/png" in output["data"] for output in shown)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_keeps_no_outputs(path):
    cells = nbformat.read(path, as_version=4).cells
    assert all(not cell.get("outputs") and cell.get("execution_count") is None for cell in cells)


def test_there_is_a_notebook_for_the_main_job():
    assert "from_drawing_to_levitation" in {path.stem for path in NOTEBOOKS}
