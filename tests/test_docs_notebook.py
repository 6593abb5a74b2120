# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The notebook of the documentation runs in a kernel of its own, and is kept without outputs."""

import os
import re
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

_EXECUTE = """
import sys, nbformat, nbclient
notebook = nbformat.read(sys.argv[1], as_version=4)
nbclient.NotebookClient(notebook, timeout=240, resources={"metadata": {"path": sys.argv[2]}}).execute()
nbformat.write(notebook, sys.argv[3])
"""


@pytest.mark.slow
def test_the_notebook_runs_and_shows_what_it_says(root: Path, tmp_path: Path) -> None:
    made = tmp_path / "made.ipynb"
    folders = {name: str(tmp_path / name) for name in ("JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR", "IPYTHONDIR")}
    command = [sys.executable, "-c", _EXECUTE, str(root / "docs/reading.ipynb"), str(root / "docs"), str(made)]
    done = subprocess.run(command, env=os.environ | folders, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    cells = nbformat.reads(made.read_text(), as_version=4).cells  # type: ignore[no-untyped-call]
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 2
    text = "".join(output.get("text", "") for output in outputs)
    assert "lost: 0" in text
    ratio = re.search(r"^5\.470 Hz: (\d\.\d+), distortion 2\.\d+ %$", text, re.MULTILINE)
    assert ratio is not None, text
    line = re.search(r"^5\.4\d Hz: \|H1\| = (\d\.\d+), coherence 0\.9", text, re.MULTILINE)
    assert line is not None, text
    assert float(line[1]) == pytest.approx(float(ratio[1]), rel=0.02)  # two estimators, one answer
    assert "a tone: the response holds there" in text


def test_the_notebook_is_kept_without_outputs(root: Path) -> None:
    notebook = nbformat.reads((root / "docs/reading.ipynb").read_text(), as_version=4)  # type: ignore[no-untyped-call]
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert code
    assert all(not cell.outputs and cell.execution_count is None for cell in code)
