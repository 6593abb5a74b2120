# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The pytest plugin, in a session of its own."""

import os
import re
import subprocess
import sys
from pathlib import Path

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


def test_what_a_session_with_the_plugin_is_like(tmp_path: Path) -> None:
    """Its check for leftovers waits 0.1 s."""
    (tmp_path / "test_it.py").write_text(TESTS)
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    (tmp_path / "conftest.py").write_text("import atpid_common.testing as plugin\nplugin.END_TIMEOUT = 0.1\n")
    command = [sys.executable, "-m", "pytest", "-p", "atpid_common.testing", "-p", "no:cacheprovider", "-q"]
    environment = {**os.environ, "OUTER": os.environ["ROS_DOMAIN_ID"]}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    left = re.findall(r"running: (thread|process) (forgotten|\d+)", done.stdout)
    assert {kind for kind, _ in left} == {"thread", "process"}
    assert re.search(r"\b4 passed.*\b2 errors", done.stdout)
