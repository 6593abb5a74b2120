# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The Python examples of the documentation run as they are printed."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from documented import PAGES, ROOT

pytestmark = pytest.mark.slow

EXAMPLES = [
    (f"{page.name}-{number}", text)
    for page in PAGES
    if page.name != "tutorial.md"  # its example needs what its commands made: test_docs_tutorial.py
    for number, text in enumerate(re.findall(r"^```python\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL))
]


def run(
    text: str, folder: Path, python: str = sys.executable, environment: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run an example in a folder that shows what a clone has, so that what it writes does not land there."""
    for name in ("scenes", "bags"):
        (folder / name).symlink_to(ROOT / name)
    command = [python, "-W", "error", "-c", text]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env=environment)


@pytest.mark.parametrize("text", [text for _, text in EXAMPLES], ids=[name for name, _ in EXAMPLES])
def test_an_example_runs_as_printed(text: str, tmp_path: Path) -> None:
    done = run(text, tmp_path)
    assert done.returncode == 0, done.stderr


def test_reading_a_bag_needs_the_packages_folders_alone(tmp_path: Path) -> None:
    """No ROS, no workspace: as docs/recording.md says for the interpreter of the environment without activation."""
    page = (ROOT / "docs/recording.md").read_text()
    shown = re.search(r"`PYTHONPATH=(\S+) \.venv/bin/python`", page)
    assert shown is not None
    text = next(text for name, text in EXAMPLES if name.startswith("recording.md"))
    places = os.pathsep.join(str(ROOT / folder) for folder in shown[1].split(":"))
    environment = {"HOME": os.environ["HOME"], "PATH": "/usr/bin:/bin", "PYTHONPATH": places}
    done = run(text, tmp_path, environment=environment)
    assert done.returncode == 0, done.stderr
    header, *rows = (tmp_path / "out/samples.csv").read_text().splitlines()
    assert header == "time,support,beam"
    assert len(rows) == 8000
