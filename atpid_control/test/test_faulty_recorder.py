# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag's file on a disk that fails as injected."""

import errno
import math
import threading
import time
from pathlib import Path

import pytest

from atpid_common.injected_faults import Injected
from atpid_control.stand.faulty_recorder import FaultySink

PIECE = bytes(range(100))


class Clock:
    """The time of a run, set by hand."""

    def __init__(self, now: float) -> None:
        self.now = now

    def __call__(self) -> float:
        return self.now


def sink(folder: Path, kind: str, value: float = math.nan) -> tuple[FaultySink, Clock, Path]:
    clock = Clock(0.5)
    file = folder / "run.mcap"
    return FaultySink(file, [Injected("recorder", kind, 1.0, 2.0, value)], clock), clock, file


def test_before_and_after_its_fault_it_is_a_file(tmp_path: Path) -> None:
    made, clock, file = sink(tmp_path, "wrong")
    clock.now = math.nan  # before the run
    made.write(PIECE)
    clock.now = 2.0
    made.write(PIECE)
    made.sync()
    assert file.read_bytes() == 2 * PIECE
    assert made.tell() == 200
    made.close()


def test_a_full_disk_refuses(tmp_path: Path) -> None:
    made, clock, file = sink(tmp_path, "wrong")
    clock.now = 1.5
    with pytest.raises(OSError, match="No space left") as refused:
        made.write(PIECE)
    assert refused.value.errno == errno.ENOSPC
    assert file.read_bytes() == b""


def test_garbage_is_one_bit_in_each_piece(tmp_path: Path) -> None:
    made, clock, file = sink(tmp_path, "garbage")
    clock.now = 1.5
    made.write(PIECE)
    different = [one ^ other for one, other in zip(file.read_bytes(), PIECE, strict=True) if one != other]
    assert [bin(one).count("1") for one in different] == [1]


@pytest.mark.parametrize(("kind", "begin"), [("stuck", 1.0), ("intermittent", 1.5)])
def test_a_disk_that_hangs_takes_the_piece_when_it_no_longer_does(tmp_path: Path, kind: str, begin: float) -> None:
    made, clock, file = sink(tmp_path, kind, 1.0 if kind == "intermittent" else math.nan)
    clock.now = begin
    writing = threading.Thread(target=made.write, args=(PIECE,))
    writing.start()
    try:
        writing.join(0.05)
        assert writing.is_alive()
        assert file.read_bytes() == b""
    finally:
        clock.now = 2.0
        writing.join()
    assert file.read_bytes() == PIECE


def test_a_slow_disk_takes_its_time(tmp_path: Path) -> None:
    made, clock, file = sink(tmp_path, "slow", 0.05)
    clock.now = 1.5
    begun = time.monotonic()
    made.write(PIECE)
    assert time.monotonic() - begun >= 0.05
    assert file.read_bytes() == PIECE


def test_delayed_pieces_keep_their_order_and_a_sync_waits_for_them(tmp_path: Path) -> None:
    made, clock, file = sink(tmp_path, "delayed", 0.05)
    clock.now = 1.5
    made.write(PIECE)
    assert (file.read_bytes(), made.tell()) == (b"", 100)
    clock.now = 2.5
    made.write(PIECE[::-1])
    made.sync()
    assert file.read_bytes() == PIECE + PIECE[::-1]
    clock.now = 1.5
    made.write(PIECE)
    made.close()
    assert len(file.read_bytes()) == 300
