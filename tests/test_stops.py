# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Stops at any instant on lines that delay, lose and garble, before the real firmware, in the board's own time."""

import math
from pathlib import Path

import pytest
from hypothesis import settings
from motor_rigs import need_emulator, words

from atpid_common.errors import InputError
from atpid_driver.emulator import Emulator
from studies import stop_chain, stops
from studies.stop_chain import WAYS, Row, Seen, into, measured
from studies.stops import LINES, Host, Noise, interleavings, table

#: With this seed so many have every kind of line; thousands: `python -m studies stops`.
INTERLEAVINGS, SEED = 360 if settings.get_current_profile_name() == "long" else 18, 126


def test_random_interleavings_break_no_rule() -> None:
    """On the wire within 30 ms, motor off within 200 ms, no height afterwards, and the answer is the board's state."""
    need_emulator()
    seen = list(interleavings(INTERLEAVINGS, SEED))
    assert [stop.problems for stop in seen if stop.problems] == []
    assert {stop.line for stop in seen} == {line.name for line in LINES}
    assert {stop.word for stop in seen} == {"STOP", "DISARM"}
    assert sum(stop.off > 0.0 for stop in seen) > INTERLEAVINGS / 2, "the motor ran in most of them"
    assert table(seen).count("\n") == len(LINES) + 2


def test_the_study_sees_a_stop_that_is_late(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
        stop = stops.stop(host, LINES[0], "STOP")
    assert any("wire" in words(problem) for problem in stop.problems)
    assert any({"off", "after"} <= words(problem) for problem in stop.problems)


#: What a machine with other work may add to a time that is allowed [s].
BUSY = 0.3


@pytest.mark.wall_time
@pytest.mark.timeout(600)
def test_ways_to_stop_end_with_the_motor_off_and_a_true_answer() -> None:
    need_emulator()
    names = ("live page: Stop", "cable pulled", "selector_node killed")
    seen = {way.name: (way, one) for way, one in measured([way for way in WAYS if way.name in names], 1, 0.016)}
    assert set(seen) == set(names)
    for name, (way, one) in seen.items():
        print(f"{name}: motor off after {one.off:.3f} s, {one.travel:.3f} m")
        assert one.off <= way.allowed + BUSY, one
        assert [problem for problem in one.problems if not problem.startswith("motor off after")] == []
    assert {"motor", "off", "confirmed"} <= words(seen["live page: Stop"][1].answer)
    assert {"selector_node", "status", "9"} <= words(seen["selector_node killed"][1].answer)


def test_the_table_has_the_worst_and_goes_between_its_lines(tmp_path: Path) -> None:
    row = Row(next(way for way in WAYS if way.name == "cable pulled"))
    row.seen[False] = [Seen(0.4, 0.12, "gone", ()), Seen(0.45, 0.13, "gone", ())]
    made = stop_chain.table([row])
    assert made.endswith("| cable pulled | 450 ms | 130 mm | 500 ms |")
    row.seen[True] = [Seen(math.nan, 0.9, "gone", ())]
    assert stop_chain.table([row]).endswith("| cable pulled | never | 900 mm | 500 ms |")
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- made by python -m studies stop-chain -->\nold\n<!-- end -->\nafter\n")
    into(page, made)
    assert page.read_text().splitlines()[2:-2] == made.splitlines()
    assert page.read_text().endswith("<!-- end -->\nafter\n")
    page.write_text("none\n")
    with pytest.raises(InputError, match=str(page)):
        into(page, made)
