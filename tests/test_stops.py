# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Stops at any instant on lines that delay, lose and garble, before the real firmware, in the board's own time."""

from pathlib import Path

import pytest
from hypothesis import settings
from motor_rigs import need_emulator, words
from stops_on_a_line import LINES, Host, Noise, interleavings, stop

from atpid_driver.emulator import Emulator

#: With this seed so many have every kind of line.
INTERLEAVINGS, SEED = 1200 if settings.get_current_profile_name() == "long" else 18, 126


def test_random_interleavings_break_no_rule() -> None:
    """On the wire within 30 ms, motor off within 200 ms, no height afterwards, and the answer is the board's state."""
    need_emulator()
    seen = list(interleavings(INTERLEAVINGS, SEED))
    assert [stop.problems for stop in seen if stop.problems] == []
    assert {stop.line for stop in seen} == {line.name for line in LINES}
    assert {stop.word for stop in seen} == {"STOP", "DISARM"}
    assert sum(stop.off > 0.0 for stop in seen) > INTERLEAVINGS / 2, "the motor ran in most of them"


def test_a_stop_that_is_late_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A host that waits for an answer before it writes a stop breaks the rules here."""
    need_emulator()
    with Emulator(tmp_path / "board", height=0.98) as emulator:
        host = Host(emulator)
        host.make_ready()
        host.line = Noise(1)
        host.dialogue.move(100_000, 1, host.now)
        host.run(0.2)
        due, called = host.dialogue.due, host.now
        monkeypatch.setattr(host.dialogue, "due", lambda now: None if now - called < 0.3 else due(now))
        late = stop(host, LINES[0], "STOP")
    assert any("wire" in words(problem) for problem in late.problems)
    assert any({"off", "after"} <= words(problem) for problem in late.problems)
