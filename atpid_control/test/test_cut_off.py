# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags that are cut off, damaged or without index: every command that reads bags reads what is there, and states it."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from atpid_control.cli import main
from atpid_control.runs.errors import BagError
from atpid_control.runs.read import open_bag
from atpid_control.runs.recover import recover
from atpid_control.runs.run import open_run

ROOT = Path(__file__).resolve().parents[2]
WHOLE, CUT = ROOT / "bags/thesis_4_3_short", ROOT / "bags/cut_off"
LINE = (
    f"{CUT}/bag_0.mcap: cut off or damaged after 2.55 s: read until sample 2549 of /sensors/laser; "
    f"`atpid bag recover {CUT}` writes a whole bag"
)
#: What each command is given besides `--out`.
COMMANDS = {
    "analyse": [str(CUT)],
    "compare": [str(CUT), str(WHOLE)],
    "export": [str(CUT), "--format", "csv"],
    "report": [str(CUT)],
    "traces": [str(CUT)],
    "validate": [str(CUT)],
}
_FILES = {"export": "a.csv", "traces": "a.mcap"}


def missing(bag: Path) -> list[str]:
    """Return what is missing in a bag, besides samples lost by index."""
    return open_bag(bag, torn_ok=True).missing


def cut(folder: Path, data: bytes, about: bool = False) -> Path:
    """Return a bag that holds these bytes."""
    folder.mkdir()
    (folder / "bag_0.mcap").write_bytes(data)
    if about:
        shutil.copy(WHOLE / "metadata.yaml", folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("command", list(COMMANDS))
def test_each_command_reads_what_is_there_and_prints_the_same_line(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (CUT / "bag_0.mcap").read_bytes()
    out = tmp_path / _FILES.get(command, "out")
    assert main(["bag", command, *COMMANDS[command], "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert [line for line in printed.out.splitlines() if line.startswith("missing: ")] == [f"missing: {LINE}"]
    assert printed.err == ""
    assert (CUT / "bag_0.mcap").read_bytes() == before
    if command == "report":
        assert "read until sample 2549 of /sensors/laser" in (out / "report.html").read_text()
    for file in out.glob("*.json"):
        assert json.loads(file.read_text())["missing"] == [LINE]


def test_the_samples_before_the_cut_are_those_of_the_whole_bag() -> None:
    few, every = (open_run(path).signal("beam_displacement").values for path in (CUT, WHOLE))
    assert len(few) == 2550
    np.testing.assert_array_equal(few, every[:2550])


def test_a_whole_bag_misses_nothing_with_and_without_its_metadata(tmp_path: Path) -> None:
    assert missing(WHOLE) == []
    assert missing(cut(tmp_path / "alone", (WHOLE / "bag_0.mcap").read_bytes())) == []


def test_a_bag_without_index_misses_no_message(tmp_path: Path) -> None:
    bag = cut(tmp_path / "bag", (WHOLE / "bag_0.mcap").read_bytes()[:-100], about=True)
    assert missing(bag) == [
        f"{bag}/bag_0.mcap: its index is cut off, every message is there; `atpid bag recover {bag}` writes a whole bag"
    ]
    assert len(open_bag(bag, torn_ok=True).raw) == len(open_bag(WHOLE).raw)


def test_what_metadata_lists_and_is_not_there_is_counted_by_topic(tmp_path: Path) -> None:
    data = (WHOLE / "bag_0.mcap").read_bytes()
    bag = cut(tmp_path / "bag", data[: len(data) // 2], about=True)
    blocks = sum(1 for _ in open_bag(bag, torn_ok=True).messages("/sensors/laser"))
    lines = missing(bag)
    assert f"read until sample {50 * blocks - 1} of /sensors/laser" in lines[0]
    assert f"{bag}: /sensors/laser: {160 - blocks} of 160 messages that metadata.yaml lists are missing" in lines


def test_a_damaged_part_ends_the_reading_and_recover_saves_what_follows(tmp_path: Path) -> None:
    data = bytearray((WHOLE / "bag_0.mcap").read_bytes())
    data[len(data) // 2] ^= 0xFF
    bag = cut(tmp_path / "bag", bytes(data), about=True)
    assert "cut off or damaged after" in missing(bag)[0]
    again = tmp_path / "again"
    recover(bag, again)
    (line,) = missing(again)
    assert line.startswith(f"{again}: recovered from a damaged bag, of which is lost: ")
    assert len(open_bag(again).raw) > len(open_bag(bag, torn_ok=True).raw)


def test_a_bag_cut_before_its_first_sample_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = cut(tmp_path / "bag", (WHOLE / "bag_0.mcap").read_bytes()[:3000])
    (line,) = missing(bag)
    assert "cut off or damaged before its first sample: 0 messages read" in line
    for command, (_, *more) in COMMANDS.items():
        if command != "traces":  # a file without traces
            out = tmp_path / command / _FILES.get(command, "out")
            assert main(["bag", command, str(bag), *more, "--out", str(out)]) == 2
            assert len(capsys.readouterr().err.splitlines()) == 1


def test_metadata_that_cannot_be_read_is_stated(tmp_path: Path) -> None:
    bag = cut(tmp_path / "bag", (WHOLE / "bag_0.mcap").read_bytes())
    (bag / "metadata.yaml").write_text("a: [1")
    (line,) = missing(bag)
    assert "not what rosbag2 writes" in line


def test_a_file_that_is_listed_and_not_there_is_refused(tmp_path: Path) -> None:
    bag = cut(tmp_path / "bag", (WHOLE / "bag_0.mcap").read_bytes(), about=True)
    (bag / "bag_0.mcap").rename(bag / "other_0.mcap")
    with pytest.raises(BagError, match=r"bag_0.mcap, which metadata.yaml lists, is missing"):
        open_run(bag)


def test_strict_reading_refuses_what_is_cut_off() -> None:
    with pytest.raises(BagError, match="recover"):
        open_bag(CUT)
