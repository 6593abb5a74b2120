# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The wheel of the physics: what docs/python.md shows runs from it, without ROS and without this repository.

`make wheel` names interpreters in ATPID_PYTHONS; each gets an empty environment from the package index. Otherwise the
wheel is unpacked beside the libraries that are there, which needs no network.
"""

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from documented import ROOT, blocks

EXAMPLE = blocks(ROOT / "docs/python.md", "python")[0]
#: What `pip wheel --no-build-isolation` calls.
BUILD = "import sys; from setuptools import build_meta; build_meta.build_wheel(sys.argv[1])"
#: Behind the example: `sweep` is there, and nothing of the workspace is loaded.
ALONE = """
import sys
assert callable(ap.sweep)
assert not {'rclpy', 'atpid_control', 'atpid_interfaces'} & set(sys.modules)
"""


def run(command: list[str | Path], folder: Path, **variables: str) -> str:
    """Run a command where nothing of the workspace is seen; return what it prints."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "ROS", "AMENT"))}
    done = subprocess.run(command, cwd=folder, env=kept | variables, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel that `make wheel` has built, or one built here in the same way."""
    if "ATPID_PYTHONS" in os.environ:
        return next((ROOT / "out/wheel").glob("*.whl"))
    folder = tmp_path_factory.mktemp("wheel")
    for source in ("atpid_sim", "atpid_interfaces/atpid_common", "extensions/atpid_dynamics"):
        name = Path(source).name
        shutil.copytree(ROOT / source / name, folder / "source" / name)
    for name in ("ros2_ws/wheel/pyproject.toml", "LICENSE"):
        shutil.copy(ROOT / name, folder / "source")
    run([sys.executable, "-c", BUILD, folder], folder / "source")
    return next(folder.glob("*.whl"))


@pytest.mark.skipif("ATPID_PYTHONS" in os.environ, reason="in empty environments below")
def test_the_page_s_first_example_runs_from_the_wheel(wheel: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(wheel) as packed:
        packed.extractall(tmp_path / "lib")
    run([sys.executable, "-W", "error", "-c", EXAMPLE + ALONE], tmp_path, PYTHONPATH=str(tmp_path / "lib"))
    assert (tmp_path / "height_map.png").stat().st_size > 20_000


@pytest.mark.skipif("ATPID_PYTHONS" not in os.environ, reason="installs from the package index: `make wheel` runs it")
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("name", os.environ.get("ATPID_PYTHONS", "").split())
def test_in_an_empty_environment(name: str, wheel: Path, tmp_path: Path) -> None:
    found = shutil.which(name)
    if found is None or subprocess.run([found, "-V"], capture_output=True, check=False).returncode:
        pytest.skip(f"{name} is not on this machine")
    run([found, "-m", "venv", "env"], tmp_path)
    python = tmp_path / "env/bin/python"
    lock = (ROOT / "ros2_ws/requirements/wheels.txt").read_text()
    (tmp_path / "versions.txt").write_text(re.sub(r"^(#.*| .*)\n| \\$", "", lock, flags=re.MULTILINE))
    run([python, "-m", "pip", "install", "-q", "-c", "versions.txt", f"{wheel}[plot,xarray]"], tmp_path)
    for words in (["-m", "atpid_sim"], ["-W", "error", "-c", EXAMPLE + ALONE]):  # compiles the kernels, uses them
        run([python, *words], tmp_path, XDG_CACHE_HOME=str(tmp_path / "cache"))
    assert (tmp_path / "height_map.png").stat().st_size > 20_000
