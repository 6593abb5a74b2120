# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The steps of docs/howto_selector.md, as they are printed: a selector in a package of its own is found and used."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

PAGE = "docs/howto_selector.md"


@pytest.fixture(scope="module")
def package(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the page's files, described as pip describes a package it has installed."""
    folder = tmp_path_factory.mktemp("package")
    page = (root / PAGE).read_text()
    for name, text in re.findall(r"`([\w.]+\.\w+)`[^`]*?\n\n```\w+\n(.*?)^```", page, re.MULTILINE | re.DOTALL):
        (folder / name).write_text(text)
    described = (folder / "pyproject.toml").read_text()
    found = re.search(r'^\[project\.entry-points\."(.+)"\]\n(.+)$', described, re.MULTILINE)
    assert found is not None
    info = folder / "proportional_height-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: proportional-height\nVersion: 1.0\n")
    entry = found[2].replace('"', "")
    (info / "entry_points.txt").write_text(f"[{found[1]}]\n{entry}\n")
    return folder


def run(command: str, folder: Path) -> str:
    program, *arguments = shlex.split(command)
    places = os.pathsep.join(filter(None, [str(folder), os.environ.get("PYTHONPATH")]))
    own = {"PYTHONPATH": places, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    done = subprocess.run(
        [sys.executable if program == "python" else program, *arguments], cwd=folder, env={**os.environ, **own},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_steps_of_the_page_run(root: Path, package: Path) -> None:
    test, select, bench = re.findall(r"^    ((?:python|atpid) .*)$", (root / PAGE).read_text(), re.MULTILINE)
    assert "1 passed" in run(f"{test} -p no:cacheprovider", package)
    chosen = json.loads(run(f"{select} --json", package))
    assert (chosen["method"], chosen["height"]) == ("proportional", pytest.approx(0.017 + 18.0 * 0.015))
    run(bench, package)
    (stage,) = json.loads((package / "out/proportional/summary.json").read_text())["stages"]
    assert stage["height"] == pytest.approx(chosen["height"], rel=0.01)
    assert stage["efficiency"] > 0.7
