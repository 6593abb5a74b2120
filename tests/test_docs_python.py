# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The Python examples of the documentation run as they are printed."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
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


def show(folder: Path) -> None:
    """Show in a folder what a clone has, so that what an example writes does not land there."""
    for name in ("scenes", "bags"):
        (folder / name).symlink_to(ROOT / name)


def run(
    text: str, folder: Path, python: str = sys.executable, environment: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run an example in a folder that shows what a clone has."""
    show(folder)
    command = [python, "-W", "error", "-c", text]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, env=environment)


#: Loads once what examples load, modules and compiled kernels, and runs each of them in a process forked from that.
FORKING = """
import json, os, sys
import atpid_control, atpid_sim, matplotlib.pyplot
scene = atpid_sim.standard_bench().with_(height=0.1)
atpid_sim.simulate(scene)
atpid_sim.steady_state(scene)
assert len(os.listdir("/proc/self/task")) == 1, "a process with threads is not to be forked"
for line in sys.stdin:
    folder, text = json.loads(line)
    child = os.fork()
    if child == 0:
        os.chdir(folder)
        said = os.open("said.txt", os.O_CREAT | os.O_WRONLY)
        os.dup2(said, 1)
        os.dup2(said, 2)
        exec(compile(text, "<example>", "exec"), {"__name__": "__main__"})
        sys.exit()
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@pytest.fixture(scope="module")
def forking() -> Iterator[subprocess.Popen[str]]:
    """The process that runs examples."""
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}  # and no threads
    command = [sys.executable, "-W", "error", "-c", FORKING]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment) as one:
        yield one


@pytest.mark.parametrize("text", [text for _, text in EXAMPLES], ids=[name for name, _ in EXAMPLES])
def test_an_example_runs_as_printed(text: str, forking: subprocess.Popen[str], tmp_path: Path) -> None:
    show(tmp_path)
    assert forking.stdin is not None
    assert forking.stdout is not None
    forking.stdin.write(json.dumps([str(tmp_path), text]) + "\n")
    forking.stdin.flush()
    status = forking.stdout.readline().strip()
    assert status == "0", (tmp_path / "said.txt").read_text()


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
