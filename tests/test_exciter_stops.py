# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Some of the ways to stop, as `python -m studies exciter-stops` tries them: the emulated stand, LabJack's package."""

import os

import pytest

from atpid_driver.emulator import missing_tools
from studies.exciter_stops import ALL, measured

pytestmark = pytest.mark.slow
#: What a machine with other work may add to a time that is allowed, and to that between two looks at the voltage [s].
BUSY = 0.3


@pytest.mark.timeout(600)
def test_a_stop_and_a_kill_end_with_the_output_off() -> None:
    if missing_tools():
        assert not os.environ.get("CI"), "CI leaves nothing out: install the AVR tools"
        pytest.skip(f"left out: the real firmware on the emulated board; missing {', '.join(missing_tools())}")
    names = ("service `supervisor_node/stop`", "excitation_node killed")
    seen = measured([way for way in ALL if way.name in names])
    assert {way.name for way, _ in seen} == set(names)
    for way, off in seen:
        assert -BUSY < off <= way.allowed + BUSY, way.name
