# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The pytest plugin, in sessions of its own."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

TESTS = """
import os, subprocess, sys, threading
import pytest

STARTED = []

def test_leaves_a_thread():
    threading.Thread(target=threading.Event().wait, daemon=True, name="forgotten").start()

def test_leaves_a_process():
    STARTED.append(subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE))

def test_has_a_domain_of_its_own():
    assert os.environ["ROS_DOMAIN_ID"] != os.environ["OUTER"]
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"

def test_warnings_are_errors(request):
    assert request.config.getini("filterwarnings")[0] == "error"
    assert request.config.pluginmanager.is_blocked("launch_testing")
"""


def session(folder: Path) -> subprocess.CompletedProcess[str]:
    """Run pytest with the plugin in a folder; the check for leftovers waits 0.1 s."""
    (folder / "pytest.ini").write_text("[pytest]\n")
    (folder / "conftest.py").write_text("import atpid_common.testing as plugin\nplugin.END_TIMEOUT = 0.1\n")
    command = [sys.executable, "-m", "pytest", "-p", "atpid_common.testing", "-p", "no:cacheprovider", "-q"]
    environment = {**os.environ, "OUTER": os.environ["ROS_DOMAIN_ID"]}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_what_a_session_with_the_plugin_is_like(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(TESTS)
    output = session(tmp_path).stdout
    assert "the test left running: thread forgotten" in output
    assert "the test left running: process " in output
    assert "4 passed, 2 errors" in output


def test_a_package_without_the_repository_is_refused(tmp_path: Path) -> None:
    (tmp_path / "package.xml").write_text("<package/>")
    done = session(tmp_path)
    assert done.returncode == 4
    assert "is tested inside the repository" in done.stdout + done.stderr
