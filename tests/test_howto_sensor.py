# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""docs/howto_sensor.md as a reader follows it: its files, its tests, its installation, and its samples."""

import os
import re
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from documented import ROOT

from atpid_control.stand.domain import own_domain

pytestmark = pytest.mark.slow

PAGE = (ROOT / "docs" / "howto_sensor.md").read_text(encoding="utf-8")
#: A block of code, and the last file named before it.
FILE = re.compile(r"`([\w.]+\.(?:py|toml|yaml))`(?:(?!```).)*?^```\w+\n(.*?)^```", re.DOTALL | re.MULTILINE)
COMMANDS = [line.split() for line in PAGE.splitlines() if line.startswith(("    python -m ", "    atpid "))]
TEST, INSTALL, NODE, ECHO = COMMANDS


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The reader's folder with the files of the page."""
    made = tmp_path_factory.mktemp("sensor")
    for name, text in FILE.findall(PAGE):
        (made / name).write_text(text)
    assert {path.name for path in made.iterdir()} == {
        "load_cell.py", "pyproject.toml", "test_load_cell.py", "force.yaml", "node.yaml",
    }  # fmt: skip
    return made


@pytest.fixture(scope="module")
def installed(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment of a process that finds the distribution, installed in a folder instead of .venv."""
    place = tmp_path_factory.mktemp("site")
    run(
        [*INSTALL[:-1], "--quiet", "--disable-pip-version-check", "--target", str(place), "."], folder, dict(os.environ)
    )
    paths = [str(place), *filter(None, [os.environ.get("PYTHONPATH", "")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


@pytest.fixture
def domain() -> Iterator[int]:
    with own_domain() as number:
        yield number


def run(arguments: list[str], folder: Path, environment: dict[str, str]) -> str:
    done = subprocess.run(arguments, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_sensor_passes_the_contract(folder: Path) -> None:
    assert "7 passed" in run([*TEST, "-p", "no:cacheprovider"], folder, dict(os.environ))


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_its_samples_arrive(folder: Path, installed: dict[str, str], domain: int) -> None:
    environment = {**installed, "ROS_DOMAIN_ID": str(domain)}
    node = subprocess.Popen(
        NODE, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        text=True,
    )  # fmt: skip
    try:
        printed = run(ECHO, folder, environment)
    finally:
        node.send_signal(signal.SIGINT)
        logged, _ = node.communicate(timeout=100.0)
    block = yaml.safe_load(printed.removesuffix("---\n"))
    assert (block["device"], block["channels"], block["units"]) == ("load-cell:4711", ["force"], ["N"])
    assert (block["rate"], len(block["data"]), block["dropped"]) == (500.0, 25, 0)
    index = [block["first_index"] + k for k in range(25)]
    assert block["data"] == pytest.approx([400.0 * abs(k / 500.0 % 1.0 - 0.5) for k in index])
    assert node.returncode == 0, logged
    assert "connected to load-cell:4711: force" in logged
