# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What CI may leave out: a test that is skipped there for any other reason fails the run."""

import os
from collections.abc import Iterable

import pytest

#: The start of each reason, and why it is one.
ALLOWED = {
    "no `ros2 launch` here": "the wheels of ROS 2 have no command line; .ci/run installs none",
    "left out: a browser draws the page": "Chromium is installed by root and with a network only",
    "no ament_lint here": "the wheels of ROS 2 have none",
    "pyarrow is missing": "`make parquet` needs a network",
    "installs from the package index": "`make wheel` needs a network, and every Python it is tried on",
    "Sphinx is missing": "`make docs-packages` needs a network",
    "npTDMS or h5py is missing": "`make import` needs a network",
    "takes the rights of root away": "CI may run as an ordinary user",
    "a network of its own needs root": "CI may run as an ordinary user",
    "this user may have no real-time priority": "CI may run as an ordinary user",
    "not in this container": "a container may refuse real-time priority to root as well",
    "another processor": "it is emulated on x86-64 only",
}


def not_allowed(reasons: Iterable[str]) -> list[str]:
    """Return the reasons of skipped tests that are none of CI's, each once."""
    given = {reason.removeprefix("Skipped: ") for reason in reasons}
    return sorted(reason for reason in given if not reason.startswith(tuple(ALLOWED)))


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail a run of CI that has left out something else; xdist's workers report to the process that has a terminal."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None or not os.environ.get("CI"):
        return
    others = not_allowed(report.longrepr[2] for report in reporter.stats.get("skipped", []))
    for reason in others:
        reporter.write_line(f"CI leaves this out, which tests/left_out.py does not allow: {reason}", red=True)
    if others and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
