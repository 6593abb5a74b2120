# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Some of the ways to stop, as `python -m studies exciter-stops` tries them: the emulated stand, LabJack's package."""

import os

import pytest

from atpid_driver.emulator import missing_tools
from studies.exciter_events import EVENTS, Occurrence
from studies.exciter_stops import measured

pytestmark = pytest.mark.slow
#: What a machine with other work may add to a time that is allowed, and to that between two looks at the voltage [s].
BUSY = 0.3


@pytest.mark.timeout(600)
def test_a_stop_and_a_kill_end_with_the_output_off() -> None:
    if missing_tools():
        assert not os.environ.get("CI"), "CI leaves nothing out: install the AVR tools"
        pytest.skip(f"left out: the real firmware on the emulated board; missing {', '.join(missing_tools())}")
    chosen = {"Ctrl-C at the terminal", "excitation"}
    events = [
        Occurrence(event.name, [case for case in event.cases if case.name in chosen])
        for event in EVENTS
        if not event.name.startswith("SIGT")
    ]
    seen = [one for _, one in measured(events, "labjack_stream")]
    assert [one.case.name for one in seen] == ["excitation", "Ctrl-C at the terminal", "excitation"]
    for one in seen:
        assert -BUSY < one.off <= one.case.allowed + BUSY, one
    assert "arm exciter" in seen[0].go_on  # a busy machine may have stopped the motor too
