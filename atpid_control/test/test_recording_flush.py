# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Flushes to the disk: nothing that is written waits for one, and one that fails ends the recording."""

import errno
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from recorded import make

from atpid_control.runs.errors import BagError
from atpid_control.runs.flush import DiskWatch, Flush
from atpid_control.runs.metadata import new_run
from atpid_control.runs.parts import MAGIC
from atpid_control.runs.recover import recover
from atpid_control.runs.verify import verify
from atpid_control.runs.writer import BagWriter, Sink, Split

STATES = "/ceiling/state"
TIMEOUT = 100.0


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


def writer(folder: Path, disk: Disk, split: Split | None = None) -> BagWriter:
    made = BagWriter(folder, new_run(run_id="small", commit="none"), sink=disk.sink, split=split)
    made.add_topic(STATES, "atpid_interfaces/msg/CeilingState")
    return made


def write(bag: BagWriter, *stamps: int) -> None:
    for stamp in stamps:
        bag.write(STATES, make("CeilingState", stamp, "motor_node"), stamp, stamp)
    bag.end_chunk()


def test_what_is_written_while_the_disk_hangs_survives_a_kill(tmp_path: Path, disk: Disk) -> None:
    bag = writer(tmp_path / "run", disk)
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
    bag = writer(tmp_path / "run", disk, Split(seconds=1e-6))
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


@pytest.mark.parametrize("act", ["sync", "close"])
def test_a_flush_that_fails_ends_the_recording(tmp_path: Path, disk: Disk, act: str) -> None:
    disk.error = OSError(errno.EIO, os.strerror(errno.EIO))
    bag = writer(tmp_path / "run", disk)
    write(bag, 0)
    disk.released.set()
    with pytest.raises(BagError, match="recording stopped after 1 messages, the disk reports an error") as caught:
        until_refused(bag.close if act == "close" else bag.sync)
    assert "\n" not in str(caught.value)
    bag.close()
    assert recover(tmp_path / "run").verified.messages == 1


def test_an_error_is_that_of_the_flushes_after_it_too() -> None:
    done: list[str] = []

    def fail() -> None:
        raise OSError(errno.EIO, "")

    flush, go = Flush(), threading.Event()
    flush.add(lambda: assert_(go.wait(TIMEOUT)))
    flush.add(fail)
    flush.add(lambda: done.append("not done"))
    go.set()
    with pytest.raises(OSError, match="Errno 5"):
        flush.finish()
    assert not done
    flush.finish()  # nothing is left


def assert_(held: bool) -> None:
    assert held


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
