# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files of a bag that are none, do not begin as one, or must not be opened."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from test_recording_recover import LASER, small

from atpid_control.runs.errors import BagError
from atpid_control.runs.read import open_bag
from atpid_control.runs.recover import recover
from atpid_control.runs.verify import verify
from atpid_control.runs.writer import Split


@pytest.mark.parametrize("begin", [b"", b"\x89MC", b"garbage" * 100])
def test_a_file_of_a_split_bag_that_is_none_costs_only_itself(tmp_path: Path, begin: bytes) -> None:
    bag = small(tmp_path / "run", split=Split(seconds=0.02))
    (bag / "run_1.mcap").write_bytes(begin)
    with pytest.raises(BagError, match="not a bag"):
        verify(bag)
    found = recover(bag)
    assert found.verified.messages == 16
    assert f"{LASER}: scans 20 to 39 lost (20)" in found.lost


def test_a_recorder_that_is_killed_while_it_begins_a_file_leaves_the_others(tmp_path: Path) -> None:
    bag = small(tmp_path / "run", split=Split(seconds=0.02), close=False)
    (bag / "run_3.mcap").write_bytes(b"")
    assert recover(bag).verified.messages == 24


def test_a_changed_first_byte_costs_nothing(tmp_path: Path) -> None:
    bag = small(tmp_path / "run")
    file = bag / "run_0.mcap"
    file.write_bytes(b"x" + file.read_bytes()[1:])
    found = recover(bag)
    assert found.verified.messages == 24
    assert found.lost == ["run_0.mcap, bytes 0 to 7: it does not begin as an MCAP file does"]


@pytest.mark.parametrize("make_other", [os.mkfifo, Path.mkdir, lambda path: path.symlink_to("/dev/zero")])
def test_what_is_no_file_is_not_opened(tmp_path: Path, make_other: Callable[[Path], None]) -> None:
    bag = small(tmp_path / "run")
    make_other(bag / "run_1.mcap")
    for read in (verify, recover, open_bag):
        with pytest.raises(BagError, match=r"run_1\.mcap: not a file; take it out"):
            read(bag)


def test_an_empty_file_is_no_bag(tmp_path: Path) -> None:
    (tmp_path / "run_0.mcap").touch()
    for read in (verify, recover):
        with pytest.raises(BagError, match="not a bag \\(it is empty\\)"):
            read(tmp_path)
