# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The records in bags/ hold what bags/README.md states of them, and every reader can use them."""

import shutil
from pathlib import Path

import pytest

from atpid_control.runs.check import check
from atpid_control.runs.errors import BagError
from atpid_control.runs.read import open_bag
from atpid_control.runs.recover import recover
from atpid_control.runs.run import open_run
from atpid_control.runs.verify import verify
from atpid_control.views.report import report

BAGS = Path(__file__).resolve().parent.parent / "bags"
WHOLE = ("thesis_4_3_short", "rumble", "laser_stuck")
LASER = "/sensors/laser"


def times(name: str, kind: str) -> list[float]:
    """Return when the record has events of this kind [s]."""
    return [ns * 1e-9 for ns, event in open_bag(BAGS / name).messages("/events") if event.kind == kind]


def test_the_page_names_every_record_and_none_is_large() -> None:
    page = (BAGS / "README.md").read_text()
    records = sorted(path for path in BAGS.iterdir() if path.is_dir())
    assert {path.name for path in records} == {*WHOLE, "cut_off"}
    for path in records:
        assert f"| `{path.name}/` |" in page
        assert sum(file.stat().st_size for file in path.iterdir()) < 500_000


@pytest.mark.parametrize("name", WHOLE)
def test_a_whole_record_is_whole_and_kept_its_rules(name: str) -> None:
    assert verify(BAGS / name).lost == ()
    assert check(BAGS / name).findings == []
    assert open_bag(BAGS / name).scene_text == (BAGS / f"{name}.yaml").read_text()


def test_the_regular_record_has_no_rumble() -> None:
    assert not times("thesis_4_3_short", "rumble")


def test_the_rumble_begins_after_the_step_and_ends_when_the_ceiling_has_come_down() -> None:
    (begin,), (end,) = times("rumble", "rumble"), times("rumble", "calm")
    assert 3.05 < begin < end < 6.0
    motion = open_run(BAGS / "rumble").motion
    ceiling = motion.ceiling[(motion.time > 3.0)]
    assert ceiling[-1] < 0.75 * ceiling[0]


def test_the_stuck_laser_is_reported_and_its_end_too_and_the_ceiling_stays_meanwhile() -> None:
    (fault,), (recovered,) = times("laser_stuck", "fault"), times("laser_stuck", "recovered")
    assert 2.5 < fault < 3.0
    assert 3.5 < recovered < 4.2
    commands = [message.height for ns, message in open_bag(BAGS / "laser_stuck").messages("/ceiling/command")
                if fault < ns * 1e-9 < 3.5]  # fmt: skip
    assert commands
    assert len({height for height in commands if height == height}) <= 1  # NaN: stay


def test_the_record_that_is_cut_off_is_refused_and_recovered(tmp_path: Path) -> None:
    cut = (BAGS / "cut_off" / "bag_0.mcap").read_bytes()
    assert (BAGS / "thesis_4_3_short" / "bag_0.mcap").read_bytes().startswith(cut)
    with pytest.raises(BagError, match="breaks off"):
        verify(BAGS / "cut_off")
    with pytest.raises(BagError, match="not closed"):
        open_bag(BAGS / "cut_off")
    made = recover(BAGS / "cut_off", tmp_path / "whole")
    whole, left = open_bag(BAGS / "thesis_4_3_short"), open_bag(tmp_path / "whole")
    assert [raw.data for raw in left.raw] == [raw.data for raw in whole.raw[: len(left.raw)]]
    last = [block for _, block in left.messages(LASER)][-1]
    assert f"{LASER}: ends with scan {last.first_index + 49}" in made.lost
    assert any(line.startswith("bag_0.mcap, bytes ") for line in made.lost)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rumble", "laser_stuck", "cut_off"])
def test_a_report_is_made_of_every_record(name: str, tmp_path: Path) -> None:
    bag = BAGS / name
    if name == "cut_off":
        bag = recover(bag, tmp_path / "whole").verified.folder
    report(bag, tmp_path / "report")
    page = (tmp_path / "report" / "report.html").read_text()
    assert "overview" in page
    shutil.rmtree(tmp_path / "report")
