"""The notebooks in samples/ run from the first cell to the last, and carry no outputs."""

import os
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NAMES = ["photograph", "clip"]
MOST_BYTES = 20_000
MOST_SECONDS = 60  # a cell; each notebook is meant to take that long as a whole


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.filterwarnings("ignore")  # what Jupyter's parts remark about each other
def test_a_notebook_runs_from_the_first_cell_to_the_last(name: str, samples: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "module://matplotlib_inline.backend_inline")
    monkeypatch.setenv("PYDEVD_DISABLE_FILE_VALIDATION", "1")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(samples.parent), os.environ.get("PYTHONPATH", "")]))
    notebook = nbformat.read(samples / f"{name}.ipynb", as_version=4)
    NotebookClient(notebook, timeout=MOST_SECONDS, resources={"metadata": {"path": str(samples)}}).execute()
    figures = [out for cell in notebook.cells for out in cell.get("outputs", ()) if "image/png" in out.get("data", {})]
    assert len(figures) >= 3


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_is_small_and_uses_public_names_alone(name: str, samples: Path) -> None:
    path = samples / f"{name}.ipynb"
    assert path.stat().st_size < MOST_BYTES
    cells = [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    assert not any(cell.outputs or cell.execution_count for cell in cells)
    source = "\n".join(cell.source for cell in cells)
    assert "rsvideo.api" not in source
    assert "from rsvideo" not in source
