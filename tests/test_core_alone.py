# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A workspace without the folder `extensions`: it builds, runs the bench, and passes the core's own tests."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from colcon_workspace import PACKAGES, ROOT, clone, environment, run, sourced
from graph_runs import scene_file

pytestmark = [pytest.mark.timeout(1200)]  # of the build
COLCON = [sys.executable, "-m", "colcon"]
MESSAGES = "atpid_interfaces"
CORE = [name for name, folder in PACKAGES.items() if not folder.startswith("extensions/")]
#: Tests of each of the core's packages that run here; all of them run in the repository.
FILES = "test_copyright_*.py test_*parameters.py test_selection_plug_ins.py test_controller_*.py"


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("workspace")
    shutil.rmtree(clone(folder / "src" / "atpid") / "extensions")
    shutil.copytree(ROOT / "ros2_ws/install" / MESSAGES, folder / "install" / MESSAGES)
    printed = run([*COLCON, "build", "--packages-skip", MESSAGES], folder, environment())
    assert {line.split()[2] for line in printed.splitlines() if line.startswith("Finished")} == {*CORE} - {MESSAGES}
    return folder


@pytest.fixture(scope="module")
def shell(workspace: Path) -> dict[str, str]:
    return sourced(workspace)


def test_its_bench_makes_its_report(shell: dict[str, str], tmp_path: Path) -> None:
    scene_file(ROOT / "scenes/thesis_4_3.yaml", tmp_path, duration=2.0, steady_window=[1.0, 2.0])
    run(["atpid", "bench", "scene.yaml", "--out", "out"], tmp_path, shell)
    assert json.loads((tmp_path / "out/summary.json").read_text())["stages"]
    assert (tmp_path / "out/report.html").is_file()


def test_a_command_of_an_extension_is_answered_with_its_package(shell: dict[str, str], tmp_path: Path) -> None:
    assert "atpid_" not in run(["atpid", "--help"], tmp_path, shell)
    done = subprocess.run(["atpid", "design"], env=shell, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert "`atpid design` comes with the package atpid_design" in done.stderr


def test_its_own_tests_pass(workspace: Path) -> None:
    part = ["--packages-skip", MESSAGES, "--pytest-args", " -o", f"python_files={FILES}"]
    run([*COLCON, "test", "--return-code-on-test-failure", *part], workspace, environment())
