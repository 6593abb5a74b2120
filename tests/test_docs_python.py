# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The Python examples of the documentation and its notebook run as they are printed."""

import json
import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
from documented import PAGES, ROOT, blocks
from matplotlib import pyplot as plt

EXAMPLES = {
    f"{page.name}-{number}": text
    for page in PAGES
    if page.name != "tutorial.md"  # its example needs what its commands made: test_docs_tutorial.py
    for number, text in enumerate(blocks(page, "python"))
}
_CELLS = json.loads((ROOT / "docs/reading.ipynb").read_text())["cells"]
_NOTEBOOK = "\n".join("".join(cell["source"]) for cell in _CELLS if cell["cell_type"] == "code")
EXAMPLES["reading.ipynb"] = _NOTEBOOK.replace("../bags", "bags").replace("plt.show()", "")


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
