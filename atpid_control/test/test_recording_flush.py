# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag on a disk that hangs or fails: nothing that is written waits for a flush, and one that fails ends it."""

import errno
import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from recorded import STATES, begin_bag, in_one_line, make

from atpid_common.injected_faults import Injected
from atpid_control.runs.errors import BagError
from atpid_control.runs.flush import DiskWatch, Flush
from atpid_control.runs.parts import MAGIC
from atpid_control.runs.recover import recover
from atpid_control.runs.verify import verify
from atpid_control.runs.writer import BagWriter, Sink, Split
from atpid_control.stand.faulty_recorder import FaultySink

TIMEOUT = 100.0
PIECE = bytes(range(100))


class Disk:
    """A disk whose flushes hang until they are released, or fail, and the index of a file that is full with them."""

    def __init__(self) -> None:
        self.begun, self.released = threading.Event(), threading.Event()
        self.error: OSError | None = None

    def sink(self, path: Path) -> Sink:
        disk = self

        class Hanging(Sink):
            def write(self, data: bytes) -> int:
                if threading.current_thread() is not threading.main_thread():
                    disk.begun.set()
                    assert disk.released.wait(TIMEOUT)
                return super().write(data)

            def sync(self) -> None:
                disk.begun.set()
                assert disk.released.wait(TIMEOUT)
                if disk.error:
                    raise disk.error
                super().sync()

        return Hanging(path)


@pytest.fixture
def disk() -> Iterator[Disk]:
    made = Disk()
    yield made
    made.released.set()


def write(bag: BagWriter, *stamps: int) -> None:
    for stamp in stamps:
        bag.write(STATES, make("CeilingState", stamp, "motor_node"), stamp, stamp)
    bag.end_chunk()


def test_what_is_written_while_the_disk_hangs_survives_a_kill(tmp_path: Path, disk: Disk) -> None:
    bag = begin_bag(tmp_path / "run", topics=[STATES], sink=disk.sink)
    write(bag, 0)
    bag.sync()
    assert disk.begun.wait(TIMEOUT)
    for stamp in range(1, 20):
        write(bag, stamp)
        bag.sync()  # none is begun while one is under way
    assert bag.flush_seconds > 0.0
    assert recover(tmp_path / "run").verified.messages == 20  # the writer is not closed
    disk.released.set()
    bag.close()
    assert verify(tmp_path / "run").messages == 20


def test_a_split_does_not_wait_for_the_disk(tmp_path: Path, disk: Disk) -> None:
    bag = begin_bag(tmp_path / "run", topics=[STATES], sink=disk.sink, split=Split(seconds=1e-6))
    write(bag, 0, 1, 2000, 2001, 4000)
    assert disk.begun.wait(TIMEOUT)
    files = sorted((tmp_path / "run").glob("*.mcap"))
    assert len(files) == 3
    assert not files[0].read_bytes().endswith(MAGIC)
    assert recover(tmp_path / "run").verified.messages == 5
    disk.released.set()
    bag.close()
    assert verify(tmp_path / "run").messages == 5


def until_refused(act: Callable[[], None]) -> None:
    while True:  # the error may be that of a flush before
        act()


@pytest.mark.parametrize("act", [BagWriter.sync, BagWriter.close])
def test_a_flush_that_fails_ends_the_recording(tmp_path: Path, disk: Disk, act: Callable[[BagWriter], None]) -> None:
    disk.error = OSError(errno.EIO, os.strerror(errno.EIO))
    bag = begin_bag(tmp_path / "run", topics=[STATES], sink=disk.sink)
    write(bag, 0)
    disk.released.set()
    with pytest.raises(BagError, match=r"after 1 .*disk") as caught:
        until_refused(lambda: act(bag))
    in_one_line(caught.value)
    bag.close()
    assert recover(tmp_path / "run").verified.messages == 1


def test_an_error_is_that_of_the_flushes_after_it_too() -> None:
    done: list[str] = []

    def fail() -> None:
        assert go.wait(TIMEOUT)
        raise OSError(errno.EIO, "")

    flush, go = Flush(), threading.Event()
    flush.add(fail)
    flush.add(lambda: done.append("not done"))
    go.set()
    with pytest.raises(OSError, match="Errno 5"):
        flush.finish()
    assert not done
    flush.finish()  # nothing is left


def test_slow_writes_are_one_episode() -> None:
    watch = DiskWatch(0.4, 2.0, 60.0)
    pushed = [watch.push(took, now) for now, took in enumerate([0.1, 0.5, 0.6, 0.1, 0.1, 0.1, 0.1, 0.9])]
    assert pushed == [None, True, None, None, None, False, None, True]
    assert watch.longest == 0.9


def test_a_disk_that_stays_busy_is_a_few_reports_and_the_next_day_is_another_one() -> None:
    watch = DiskWatch(0.4, 2.0, 60.0)
    hour = [watch.push(0.5 if now % 5 == 0 else 0.1, now) for now in range(3600)]
    assert 2 <= hour.count(True) <= 3  # one each 5 s without the rule
    assert [watch.push(0.1, 4000.0), watch.push(0.5, 8000.0)] == [False, True]
    assert [watch.push(0.1, 8003.0)] == [False]  # after 2 s again


class Faulty:
    """A file with an injected fault from 1 s to 2 s of a run whose time is set by hand."""

    def __init__(self, folder: Path, kind: str, value: float = math.nan) -> None:
        self.now, self.file = 0.5, folder / "run.mcap"
        self.sink = FaultySink(self.file, [Injected("recorder", kind, 1.0, 2.0, value)], lambda: self.now)

    def write(self, now: float, data: bytes = PIECE) -> bytes:
        """Write a piece at an instant of the run; return what is in the file then."""
        self.now = now
        self.sink.write(data)
        return self.file.read_bytes()


def test_before_and_after_its_fault_it_is_a_file(tmp_path: Path) -> None:
    made = Faulty(tmp_path, "wrong")
    assert made.write(math.nan) == PIECE  # before the run
    assert made.write(2.0) == 2 * PIECE
    made.sink.sync()
    assert made.sink.tell() == 200
    made.sink.close()


def test_a_full_disk_refuses(tmp_path: Path) -> None:
    made = Faulty(tmp_path, "wrong")
    with pytest.raises(OSError, match="Errno") as refused:
        made.write(1.5)
    assert refused.value.errno == errno.ENOSPC
    assert made.file.read_bytes() == b""


def test_garbage_is_one_bit_in_each_piece(tmp_path: Path) -> None:
    got = Faulty(tmp_path, "garbage").write(1.5)
    different = [one ^ other for one, other in zip(got, PIECE, strict=True) if one != other]
    assert [one.bit_count() for one in different] == [1]


@pytest.mark.parametrize(("kind", "begin"), [("stuck", 1.0), ("intermittent", 1.5)])
def test_a_disk_that_hangs_takes_the_piece_when_it_no_longer_does(tmp_path: Path, kind: str, begin: float) -> None:
    made = Faulty(tmp_path, kind, 1.0 if kind == "intermittent" else math.nan)
    made.now = begin
    writing = threading.Thread(target=made.sink.write, args=(PIECE,))
    writing.start()
    try:
        writing.join(0.05)
        assert writing.is_alive()
        assert made.file.read_bytes() == b""
    finally:
        made.now = 2.0
        writing.join()
    assert made.file.read_bytes() == PIECE


def test_a_slow_disk_takes_its_time(tmp_path: Path) -> None:
    made, begun = Faulty(tmp_path, "slow", 0.05), time.monotonic()
    assert made.write(1.5) == PIECE
    assert time.monotonic() - begun >= 0.05


def test_delayed_pieces_keep_their_order_and_a_sync_waits_for_them(tmp_path: Path) -> None:
    made = Faulty(tmp_path, "delayed", 0.05)
    assert made.write(1.5) == b""
    assert made.sink.tell() == 100
    made.write(2.5, PIECE[::-1])
    made.sink.sync()
    assert made.file.read_bytes() == PIECE + PIECE[::-1]
    made.write(1.5)
    made.sink.close()
    assert len(made.file.read_bytes()) == 300
