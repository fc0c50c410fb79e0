"""Run the notebooks of the docs and keep what they show: ``python docs/figures/notebooks.py``.

Names of notebooks may follow; all take minutes. tests/test_notebook.py says whether what they show
is that of the code.
"""

import sys
import tempfile
from pathlib import Path

import nbclient
import nbformat

DOCS = Path(__file__).parents[1]
NOTEBOOKS = [DOCS / "tour.ipynb", *sorted((DOCS / "notebooks").glob("*.ipynb"))]

# Of a cell, s
LONGEST = 600.0


def ran(file: Path) -> nbformat.NotebookNode:
    """The notebook with its outputs, run in an empty folder, without times and kinds of kernel."""
    notebook = nbformat.read(file, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        place = {"metadata": {"path": folder}}
        nbclient.NotebookClient(notebook, timeout=LONGEST, resources=place).execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
    notebook.metadata.get("language_info", {}).pop("version", None)
    return notebook


if __name__ == "__main__":
    for file in NOTEBOOKS:
        if len(sys.argv) == 1 or file.stem in sys.argv[1:]:
            nbformat.write(ran(file), file)
            print(file.relative_to(DOCS.parent), f"{file.stat().st_size / 1e3:.0f} kB")
