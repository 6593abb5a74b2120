# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The Python examples of the documentation and its notebook run as they are printed."""

import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import nbformat
import pytest
from documented import PAGES, ROOT, blocks
from matplotlib import pyplot as plt

EXAMPLES = {
    f"{page.name}-{number}": text
    for page in PAGES
    if page.name != "tutorial.md"  # its example needs what its commands made: test_docs_tutorial.py
    for number, text in enumerate(blocks(page, "python"))
}
#: Runs a notebook in a kernel of its own: FILE FOLDER RESULT.
EXECUTE = """
import sys, nbformat, nbclient
notebook = nbformat.read(sys.argv[1], as_version=4)
nbclient.NotebookClient(notebook, timeout=240, resources={"metadata": {"path": sys.argv[2]}}).execute()
nbformat.write(notebook, sys.argv[3])
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that shows what a clone has, so that what an example writes does not land there."""
    for name in ("scenes", "bags"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs_as_printed(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        exec(compile(EXAMPLES[name], name, "exec"), {"__name__": "__main__"})
    plt.close("all")


def test_reading_a_bag_needs_the_packages_folders_alone(folder: Path) -> None:
    """No ROS, no workspace: as docs/recording.md says for the interpreter of the environment without activation."""
    shown = re.search(r"`PYTHONPATH=(\S+) \.venv/bin/python`", (ROOT / "docs/recording.md").read_text())
    assert shown is not None
    places = os.pathsep.join(str(ROOT / part) for part in shown[1].split(":"))
    environment = {"HOME": os.environ["HOME"], "PATH": "/usr/bin:/bin", "PYTHONPATH": places}
    command = [sys.executable, "-W", "error", "-c", EXAMPLES["recording.md-0"]]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    header, *rows = (folder / "out/samples.csv").read_text().splitlines()
    assert header == "time,support,beam"
    assert len(rows) == 8000


def test_the_notebook_is_kept_without_outputs_and_shows_what_it_says(tmp_path: Path) -> None:
    kept, made = ROOT / "docs/reading.ipynb", tmp_path / "made.ipynb"
    code = [cell for cell in nbformat.reads(kept.read_text(), as_version=4).cells if cell.cell_type == "code"]  # type: ignore[no-untyped-call]
    assert code
    assert all(not cell.outputs and cell.execution_count is None for cell in code)
    folders = {name: str(tmp_path / name) for name in ("JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR", "IPYTHONDIR")}
    command = [sys.executable, "-c", EXECUTE, str(kept), str(kept.parent), str(made)]
    done = subprocess.run(command, env=os.environ | folders, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    cells = nbformat.reads(made.read_text(), as_version=4).cells  # type: ignore[no-untyped-call]
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 2
    text = "".join(output.get("text", "") for output in outputs)
    assert "lost: 0" in text
    (ratio,) = re.findall(r"^5\.470 Hz: (\d\.\d+), distortion 2\.\d+ %$", text, re.MULTILINE)
    (line,) = re.findall(r"^5\.4\d Hz: \|H1\| = (\d\.\d+), coherence 0\.9", text, re.MULTILINE)
    assert float(line) == pytest.approx(float(ratio), rel=0.02)  # two estimators, one answer
