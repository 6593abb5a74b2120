# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Some of the ways to stop, as `python -m studies exciter-stops` tries them: the emulated stand, LabJack's package."""

import os

import pytest

from atpid_driver.emulator import missing_tools
from studies.exciter_events import EVENTS, Occurrence
from studies.exciter_stops import measured

#: What may be added to a time that is allowed, and to that between two looks at the voltage [s].
BUSY = 0.45


@pytest.mark.wall_time
def test_a_stop_and_a_kill_end_with_the_output_off() -> None:
    if missing_tools():
        assert not os.environ.get("CI"), "CI leaves nothing out: install the AVR tools"
        pytest.skip(f"left out: the real firmware on the emulated board; missing {', '.join(missing_tools())}")
    chosen = {"SIGSTOP of a node": "excitation", "Ctrl-C at the terminal": "Ctrl-C at the terminal"}
    events = [
        Occurrence(event.name, [case for case in event.cases if case.name == chosen[event.name]])
        for event in EVENTS
        if event.name in chosen
    ]
    (name, halted), (last, ended) = measured(events, "labjack_stream")
    assert [name, last] == list(chosen)
    for one in (halted, ended):
        assert -BUSY < one.off <= one.case.allowed + BUSY, one
    assert {"arm", "exciter"} <= set(halted.go_on.replace(",", "").split())  # the motor may have been stopped too
