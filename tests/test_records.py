# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The records in bags/ hold what bags/README.md states of them, and every reader can use them."""

from pathlib import Path

import pytest
from documented import ROOT

from atpid_control.runs.check import check
from atpid_control.runs.errors import BagError
from atpid_control.runs.read import open_bag
from atpid_control.runs.recover import recover
from atpid_control.runs.run import open_run
from atpid_control.runs.verify import verify
from atpid_control.views.report.page import report

BAGS = ROOT / "bags"
WHOLE = ("thesis_4_3_short", "rumble", "laser_stuck")
LASER = "/sensors/laser"


def times(name: str, kind: str) -> list[float]:
    """Return when the record has events of this kind [s]."""
    return [ns * 1e-9 for ns, event in open_bag(BAGS / name).messages("/events") if event.kind == kind]


@pytest.mark.parametrize("name", WHOLE)
def test_a_whole_record_is_whole_kept_its_rules_and_is_reported(name: str, tmp_path: Path) -> None:
    found = check(BAGS / name)
    assert (found.verified.lost, found.findings) == ((), [])
    assert open_bag(BAGS / name).scene_text == (BAGS / f"{name}.yaml").read_text()
    report(BAGS / name, tmp_path)
    assert "overview" in (tmp_path / "report.html").read_text()


def test_the_rumble_begins_after_the_step_and_ends_when_the_ceiling_has_come_down() -> None:
    assert not times("thesis_4_3_short", "rumble")
    (begin,), (end,) = times("rumble", "rumble"), times("rumble", "calm")
    assert 3.05 < begin < end < 6.0
    motion = open_run(BAGS / "rumble").motion
    ceiling = motion.ceiling[motion.time > 3.0]
    assert ceiling[-1] < 0.75 * ceiling[0]


def test_the_stuck_laser_is_reported_and_its_end_too_and_the_ceiling_stays_meanwhile() -> None:
    (fault,), (recovered,) = times("laser_stuck", "fault"), times("laser_stuck", "recovered")
    assert 2.5 < fault < 3.0
    assert 3.5 < recovered < 4.2
    commands = open_bag(BAGS / "laser_stuck").messages("/ceiling/command")
    heights = [message.height for ns, message in commands if fault < ns * 1e-9 < 3.5]
    assert heights
    assert len({height for height in heights if height == height}) <= 1  # NaN: stay


def test_the_record_that_is_cut_off_is_refused_and_recovered(tmp_path: Path) -> None:
    cut, source = BAGS / "cut_off", BAGS / "thesis_4_3_short"
    assert (source / "bag_0.mcap").read_bytes().startswith((cut / "bag_0.mcap").read_bytes())
    with pytest.raises(BagError, match="breaks off"):
        verify(cut)
    with pytest.raises(BagError, match=r"not closed.*recover"):
        open_bag(cut)
    made = recover(cut, tmp_path / "whole")
    whole, left = open_bag(source), open_bag(tmp_path / "whole")
    assert [raw.data for raw in left.raw] == [raw.data for raw in whole.raw[: len(left.raw)]]
    last = [block for _, block in left.messages(LASER)][-1]
    lost = "\n".join(made.lost)
    assert f"{LASER}: " in lost
    assert f" {last.first_index + 49}" in lost
    assert "bag_0.mcap" in lost


@pytest.mark.parametrize("record", [*ROOT.glob("docs/decisions/0*.md")], ids=lambda record: record.stem)
def test_a_record_of_a_decision_is_short(record: Path) -> None:
    assert record.read_text(encoding="utf-8").count("\n") <= 45
