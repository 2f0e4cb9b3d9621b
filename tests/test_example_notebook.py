"""The example notebook runs as it stands, and git holds it without outputs."""

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOK = ROOT / "examples" / "forecast_a_recording.ipynb"


@pytest.mark.long
def test_the_notebook_runs_and_is_stored_without_outputs():
    nbformat = pytest.importorskip("nbformat", reason="needs the extra 'notebook'")
    nbclient = pytest.importorskip("nbclient", reason="needs the extra 'notebook'")
    pytest.importorskip("ipykernel", reason="needs the extra 'notebook'")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(not cell.outputs and cell.execution_count is None for cell in cells)
    nbclient.NotebookClient(
        notebook, timeout=300, resources={"metadata": {"path": str(ROOT)}}
    ).execute()
    said = [str(output) for cell in cells for output in cell.outputs]
    assert sum("image/png" in text for text in said) == 2  # the errors and the zones
    assert "scenes at 30.0 Hz" in said[0]
