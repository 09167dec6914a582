"""Every notebook runs from top to bottom, and none keeps outputs in git."""

import ast
import re
import shutil
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

import femfit as ff

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
SHORTER = {"runs=20": "runs=4", "held == 20": "held == 4", "seconds=3.0": "seconds=1.0"}
SPARSE = {"distance_mm = { start = 15, stop = 45, step = 0.5 }": "distance_mm = { start = 15, stop = 45, step = 1 }"}


@pytest.fixture
def workplace(request, tmp_path):
    """A project's notebooks, drawings and data; where a sweep's steps do not matter, a quicker one."""
    for name in ("data", "geometry", "notebooks"):
        shutil.copytree(ROOT / name, tmp_path / name)
    notebook = request.getfixturevalue("path").stem
    if notebook == "from_drawing_to_levitation":
        drawing = tmp_path / "geometry" / "emaws-rig.toml"
        text = drawing.read_text()
        for old, new in SPARSE.items():
            assert old in text
            text = text.replace(old, new)
        drawing.write_text(text)
    return tmp_path


@pytest.mark.nightly
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(path, workplace):
    notebook = nbformat.read(path, as_version=4)
    if path.stem == "from_drawing_to_levitation":
        for cell in notebook.cells:
            for old, new in SHORTER.items():
                cell.source = cell.source.replace(old, new)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(workplace / "notebooks")}}).execute()
    shown = [output for cell in notebook.cells for output in cell.get("outputs", []) if "data" in output]
    assert any("image/png" in output["data"] for output in shown)


@pytest.mark.nightly
def test_the_bench_of_the_notebook_still_lacks_the_effects_that_it_names(rig_sweep):
    found = ff.diagnose(ff.fit_model(rig_sweep).model, ROOT / "data" / "levitation_bench.csv")
    assert {effect.name for effect in found.missing} == {"coil_temperature", "core_saturation"}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_python_that_uses_public_names_alone(path):
    cells = [cell.source for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    nodes = [
        node for source in cells for node in ast.walk(ast.parse(re.sub(r"^[!%].*", "", source, flags=re.MULTILINE)))
    ]
    used = {node.attr for node in nodes if isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "ff"}
    assert used <= set(ff.__all__)
    inner = {
        node.module for node in nodes if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("femfit.")
    }
    assert not inner


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_keeps_no_outputs(path):
    cells = nbformat.read(path, as_version=4).cells
    assert all(not cell.get("outputs") and cell.get("execution_count") is None for cell in cells)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_copy_beside_the_pages_is_this_notebook_as_it_ran(path):
    cells = nbformat.read(path, as_version=4).cells
    shown = nbformat.read(ROOT / "docs" / "tutorial" / path.name, as_version=4).cells
    # Where this fails, or femfit answers otherwise: python docs/_ext/run_notebooks.py
    assert [(cell.cell_type, cell.source) for cell in shown] == [(cell.cell_type, cell.source) for cell in cells]
    outputs = [output for cell in shown for output in cell.get("outputs", [])]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert not any(output.output_type == "error" or output.get("name") == "stderr" for output in outputs)
