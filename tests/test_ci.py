# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""CI runs the tests in an environment that hides nothing."""

import os
import re
import subprocess
from pathlib import Path


def test_ci_runs_the_tests_in_a_clean_environment(root: Path, tmp_path: Path) -> None:
    make = tmp_path / "make"
    make.write_text('#!/bin/sh\nenv > "${0%/*}/$1.env"\n')
    make.chmod(0o755)
    given = {"PATH": f"{tmp_path}:/usr/bin:/bin", "CI": "true", "PYTHONUNBUFFERED": "1", "PIP_INDEX_URL": "file:///"}
    subprocess.run(["bash", root / ".ci/run"], env=os.environ | given, check=True)
    seen = dict(line.split("=", 1) for line in (tmp_path / "test.env").read_text().splitlines())
    assert seen.keys() - {"PWD", "OLDPWD", "SHLVL", "_"} == {"HOME", "PATH", "LANG", "CI"}
    assert (seen["CI"], seen["HOME"]) == ("true", os.environ["HOME"])
    assert "PIP_INDEX_URL=file:///" in (tmp_path / "test-packages.env").read_text()


def test_the_container_has_what_the_readme_names(root: Path) -> None:
    readme = re.search(r"`apt install ([^`]+)`", (root / "README.md").read_text())
    container = re.search(r"--no-install-recommends \\\n\s+([^&]+) &&", (root / "ros2_ws/Containerfile").read_text())
    assert readme
    assert container
    # git for the record of a run's commit, certificates for the package index: a machine with a clone has both
    assert container[1].split() == ["ca-certificates", "git", *readme[1].split()]
