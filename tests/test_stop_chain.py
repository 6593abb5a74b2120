# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Some of the ways to stop, as `python -m studies stop-chain` tries them: the whole emulated stand, real firmware."""

import math
from pathlib import Path

import pytest
from motor_rigs import need_emulator, words

from atpid_common.errors import InputError
from studies.stop_chain import WAYS, Row, Seen, into, measured, table

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
    row.seen[True] = [Seen(math.nan, 0.9, "gone", ())]
    made = table([row], 0.016)
    assert made.splitlines()[-1].split(" | ")[1:] == ["450 ms", "never", "900 mm", "gone", "500 ms |"]
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- made by python -m studies stop-chain -->\nold\n<!-- end -->\nafter\n")
    into(page, made)
    assert page.read_text().splitlines()[2:-2] == made.splitlines()
    assert page.read_text().endswith("<!-- end -->\nafter\n")
    page.write_text("none\n")
    with pytest.raises(InputError, match=str(page)):
        into(page, made)
