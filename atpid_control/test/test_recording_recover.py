# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is left of a damaged bag, with what is lost by sample index; bags on a disk that hangs or fails."""

import errno
import math
import os
import re
import struct
import threading
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import yaml
import zstandard
from mcap.reader import make_reader
from recorded import LASER, STATES, Capture, begin_bag, block, in_one_line, make, peak_of, refused, write_bag
from rosbags.rosbag2 import Reader

from atpid_common.injected_faults import Injected
from atpid_common.testing import PATIENCE
from atpid_control.cli import main
from atpid_control.recording.session import DiskWatch
from atpid_control.runs.errors import BagError
from atpid_control.runs.parts import MAGIC
from atpid_control.runs.read import open_bag
from atpid_control.runs.records import LARGEST_CHUNK, inside
from atpid_control.runs.recover import recover, repair
from atpid_control.runs.salvage import salvage
from atpid_control.runs.verify import verify
from atpid_control.runs.writer import BagWriter, Flush, Sink, Split
from atpid_control.stand.faulty_recorder import FaultySink

SCANS = 5
THREE_FILES = Split(seconds=0.02)


def small(folder: Path, *, close: bool = True, each: int = 2, split: Split | None = None) -> Path:
    """Write a bag of 12 blocks of 5 scans, one state with each, `each` blocks to a chunk; return its folder."""
    noise = np.random.default_rng(1)
    messages = []
    for number in range(12):
        stamp = 5_000_000 * number
        messages.append((LASER, block(SCANS * number, noise.normal(size=(SCANS, 2)))))
        messages.append((STATES, make("CeilingState", stamp, "motor_node")))
    writer = begin_bag(folder, messages, topics=(LASER, STATES), each=2 * each, split=split)
    if close:
        writer.close({"finished": "yes"})
    return folder


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Return a whole bag of one file."""
    return small(tmp_path / "run")


def chunk_places(file: Path) -> list[tuple[int, int]]:
    """Return where each chunk's record begins and ends."""
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    return [(one.chunk_start_offset, one.chunk_start_offset + one.chunk_length) for one in summary.chunk_indexes]


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_chunk_with_a_wrong_checksum_costs_that_chunk_and_is_named_by_index(bag: Path) -> None:
    file = bag / "run_0.mcap"
    begin, end = chunk_places(file)[2]
    data = bytearray(file.read_bytes())
    data[begin + 9 + 24] ^= 1  # of the checksum
    file.write_bytes(data)
    found = recover(bag)
    again = bag.with_name("run-recovered")
    assert (found.verified.folder, found.verified.messages) == (again, 20)
    place, states, scans = found.lost
    assert place.startswith(f"run_0.mcap, bytes {begin} to {end - 1}: ")
    assert (states.split()[:5], states[-3:]) == ([f"{STATES}:", "messages", "4", "to", "5"], "(2)")
    assert (scans.split()[:5], scans[-4:]) == ([f"{LASER}:", "scans", "20", "to", "29"], "(10)")
    assert list(verify(again).lost) == [states, scans]
    stated = yaml.safe_load((again / "metadata.yaml").read_text())
    assert scans[len(LASER) : -5] in stated["rosbag2_bagfile_information"]["custom_data"]["lost"]


def with_length(file: Path, length: int) -> bytes:
    begin, _ = chunk_places(file)[1]
    data = file.read_bytes()
    return data[: begin + 1] + struct.pack("<Q", length) + data[begin + 9 :]


def bomb(file: Path, stated: int, compression: str) -> bytes:
    """Return the file with a chunk of 16 MB in the place of the second, which states another size."""
    begin, end = chunk_places(file)[1]
    name, data = compression.encode(), zstandard.ZstdCompressor().compress(bytes(2**24))
    body = struct.pack("<QQQII", 0, 1, stated, 0, len(name)) + name + struct.pack("<Q", len(data)) + data
    whole = file.read_bytes()
    return whole[:begin] + struct.pack("<BQ", 6, len(body)) + body + whole[end:]


SECOND = r"scans 10 to 19 .*\(10\)"
#: What is left of a file of six chunks, of four messages each; how many messages, and the scans that are named as lost.
DAMAGED: dict[str, tuple[Callable[[Path], bytes], int, str]] = {
    "tail": (lambda file: file.read_bytes()[: chunk_places(file)[4][0] + 30], 16, r"messages 8 to 11 .*\(4\), .* 40 "),
    "first byte": (lambda file: b"x" + file.read_bytes()[1:], 24, "bytes 0 to 7: "),
    "no index": (lambda file: with_length(file, 2**40)[:-200], 20, SECOND),
}
for length in (0, 1, 2**31, 2**40, 2**63, 2**64 - 1):
    DAMAGED[f"length {length}"] = (partial(with_length, length=length), 20, SECOND)
for stated, compression in product((100, 2**20, LARGEST_CHUNK + 1, 2**63), ("zstd", "lz4", "", "gzip")):
    DAMAGED[f"{stated} bytes in {compression}"] = (partial(bomb, stated=stated, compression=compression), 20, SECOND)


@pytest.mark.parametrize("name", DAMAGED)
def test_what_is_whole_is_recovered_and_what_is_not_named(name: str, bag: Path) -> None:
    damage, messages, lost = DAMAGED[name]
    file = bag / "run_0.mcap"
    data = damage(file)
    file.write_bytes(data)
    with pytest.raises(BagError) as caught:
        verify(bag)
    in_one_line(caught.value, "run_0.mcap")
    found = recover(bag)
    assert found.verified.messages == messages
    assert any(re.search(lost, line) for line in found.lost), found.lost
    assert file.read_bytes() == data


def test_a_bag_that_was_not_closed_names_its_last_scan_and_what_may_be_missing(tmp_path: Path, capsys: Capture) -> None:
    bag = small(tmp_path / "run", close=False)
    found = recover(bag)
    assert found.verified.messages == 24
    assert "0.02 s" in found.lost[-2]
    assert found.lost[-1].startswith(f"{LASER}: ")
    assert found.lost[-1].endswith(" 59")
    assert [main(["bag", "check", str(bag), *more]) for more in ([], ["--file"])] == [2, 2]
    assert f"lost: {found.lost[-1]}" in capsys.readouterr().out


def test_scans_lost_before_the_recorder_are_told_from_those_lost_in_the_file(tmp_path: Path) -> None:
    blocks = [(LASER, block(SCANS * number, np.zeros((SCANS, 2)))) for number in (0, 1, 3)]
    (line,) = verify(write_bag(tmp_path / "run", blocks)).lost
    assert line.startswith(f"{LASER}: scans 10 to 14 ")
    assert "before" in line


def test_public_readers_seek_in_a_recovered_bag(tmp_path: Path) -> None:
    made = recover(small(tmp_path / "run", close=False)).verified.folder
    with next(made.glob("*.mcap")).open("rb") as stream:
        found = make_reader(stream, validate_crcs=True).iter_messages(topics=[LASER], starting_at=40_000_000)
        assert [message.log_time for _, _, message in found] == [40_000_000, 45_000_000, 50_000_000, 55_000_000]
    with Reader(made) as other:
        assert sum(1 for _ in other.messages(start=40_000_000)) == 8


def test_nothing_is_written_over(tmp_path: Path, capsys: Capture) -> None:
    bag = small(tmp_path / "run", close=False)
    assert not recover(small(tmp_path / "whole")).made  # nothing is lost
    (tmp_path / "run-recovered").mkdir()
    refused(capsys, ["bag", "recover", bag], "run-recovered", "exists")
    assert main(["bag", "recover", str(bag), "--out", str(tmp_path / "other")]) == 0
    assert f"lost: {LASER}: ends" in capsys.readouterr().out
    refused(capsys, ["bag", "check", bag, "--out", tmp_path])
    refused(capsys, ["bag", "verify", bag], "`atpid bag check`")


@pytest.mark.parametrize("write", [recover, repair])
def test_a_full_disk_leaves_nothing_of_a_recovery(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write: Callable[[Path], object]
) -> None:
    bag = small(tmp_path / "run", close=False)
    before = contents(tmp_path)

    def full(_file: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(BagError) as caught:
        write(bag)
    in_one_line(caught.value, "full")
    assert contents(tmp_path) == before


def test_a_chunk_of_many_records_takes_no_memory_for_all() -> None:
    data = struct.pack("<BQHIQQ", 5, 22, 1, 0, 0, 0) * 20_000
    counts = list[int]()
    assert peak_of(lambda: counts.append(sum(1 for _ in inside(data)))) < len(data) + 100_000
    assert counts == [20_000]


def test_a_split_bag_is_one_bag_to_every_reader(tmp_path: Path, bag: Path) -> None:
    split = small(tmp_path / "split", split=THREE_FILES)
    files = sorted(file.name for file in split.glob("*.mcap"))
    assert files == ["split_0.mcap", "split_1.mcap", "split_2.mcap"]
    information = yaml.safe_load((split / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert information["relative_file_paths"] == files
    assert [entry["message_count"] for entry in information["files"]] == [8, 8, 8]
    begins = [entry["starting_time"]["nanoseconds_since_epoch"] for entry in information["files"]]
    assert begins == [0, 20_000_000, 40_000_000]
    assert verify(split).by_topic == verify(bag).by_topic
    assert not verify(split).lost
    ours, theirs = open_bag(split), open_bag(bag)
    assert [(raw.topic, raw.log_ns, raw.data) for raw in ours.raw] == [
        (raw.topic, raw.log_ns, raw.data) for raw in theirs.raw
    ]
    assert ours.types == theirs.types
    assert ours.result == {"finished": "yes"}
    with Reader(split) as reader:
        assert reader.message_count == sum(1 for _ in reader.messages()) == 24
    for file in split.glob("*.mcap"):  # each can be read alone
        assert open_bag(file).run["run_id"] == "small"
    many = small(tmp_path / "many", each=1, split=Split(seconds=0.005))
    assert len(list(many.glob("*.mcap"))) == 12
    assert not verify(many).lost  # the tenth is behind the ninth


def test_a_file_of_a_split_bag_that_is_missing_is_named(tmp_path: Path) -> None:
    bag = small(tmp_path / "run", split=Split(size=1500))
    files = sorted(bag.glob("*.mcap"))
    assert len(files) > 2
    files[1].rename(tmp_path / "elsewhere.mcap")
    for read in (verify, open_bag):
        with pytest.raises(BagError, match=r"run_1\.mcap.*metadata\.yaml.*missing"):
            read(bag)
    found = recover(bag)
    assert any(line.startswith(f"{LASER}: scans ") for line in found.lost)
    assert verify(found.verified.folder).messages < 24


@pytest.mark.parametrize(
    ("place", "content", "close", "messages"),
    [(1, b"", True, 16), (1, b"\x89MC", True, 16), (1, b"garbage" * 100, True, 16), (3, b"", False, 24)],
)
def test_a_file_of_a_split_bag_that_is_none_costs_only_itself(
    place: int, content: bytes, close: bool, messages: int, tmp_path: Path
) -> None:
    """The last: a recorder is killed while it begins a file."""
    bag = small(tmp_path / "run", split=THREE_FILES, close=close)
    (bag / f"run_{place}.mcap").write_bytes(content)
    with pytest.raises(BagError, match="not a bag"):
        verify(bag)
    found = recover(bag)
    assert found.verified.messages == messages
    assert (f"{LASER}: scans 20 to 39 lost (20)" in found.lost) == close


def test_the_disk_that_fills_up_at_a_split_is_one_line(tmp_path: Path) -> None:
    class Second(Sink):
        def __init__(self, path: Path) -> None:
            if path.name != "run_0.mcap":
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            super().__init__(path)

    state = make("CeilingState")
    writer = begin_bag(tmp_path / "run", [(STATES, state)], topics=[STATES], sink=Second, split=Split(seconds=0.01))
    with pytest.raises(BagError) as caught:
        writer.write(STATES, state, 10**8, 10**8)
    in_one_line(caught.value, "full")
    assert recover(tmp_path / "run").verified.messages == 1


def test_every_step_of_a_salvage_goes_forward(tmp_path: Path) -> None:
    file = tmp_path / "x.mcap"
    for piece in (b"\x06", b"\x06" + bytes(8), struct.pack("<BQQQQII", 6, 40, 0, 0, 0, 0, 0) + bytes(8), b"\x05" * 9):
        file.write_bytes(MAGIC + piece * 3000)
        assert sum(1 for _ in salvage(file)) < 3010


@pytest.mark.parametrize("make_other", [os.mkfifo, Path.mkdir, lambda path: path.symlink_to("/dev/zero")])
def test_what_is_no_file_is_not_opened(bag: Path, make_other: Callable[[Path], None]) -> None:
    make_other(bag / "run_1.mcap")
    for read in (verify, recover, open_bag):
        with pytest.raises(BagError, match=r"run_1\.mcap: not a file"):
            read(bag)


def test_what_the_index_does_not_lead_to_is_no_whole_bag_and_recover_leads_to_it_again(bag: Path) -> None:
    """A chunk is missing in the index, all records are whole: other programs would miss its messages unnoticed."""
    chunk_index, footer = 0x08, 0x02
    file = bag / "run_0.mcap"
    content = file.read_bytes()
    summary, offsets, _ = struct.unpack_from("<QQI", content, len(content) - len(MAGIC) - 20)
    records, at = [], summary
    while at < offsets:
        opcode, length = struct.unpack_from("<BQ", content, at)
        records.append((opcode, content[at : at + 9 + length]))
        at += 9 + length
    records.remove(next(record for record in records if record[0] == chunk_index))
    kept = b"".join(record for _, record in records)
    file.write_bytes(content[:summary] + kept + struct.pack("<BQQQI", footer, 20, summary, 0, 0) + MAGIC)
    with pytest.raises(BagError, match=r"20 of 24 .*recover"):
        verify(bag)
    assert main(["bag", "check", str(bag)]) == 1
    recover(bag)
    assert verify(bag.with_name("run-recovered")).messages == 24


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
                    assert disk.released.wait(PATIENCE)
                return super().write(data)

            def sync(self) -> None:
                disk.begun.set()
                assert disk.released.wait(PATIENCE)
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
    assert disk.begun.wait(PATIENCE)
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
    assert disk.begun.wait(PATIENCE)
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
    flush, go, done = Flush(), threading.Event(), threading.Event()

    def fail() -> None:
        assert go.wait(PATIENCE)
        raise OSError(errno.EIO, "")

    flush.add(fail)
    flush.add(done.set)
    go.set()
    with pytest.raises(OSError, match="Errno 5"):
        flush.finish()
    assert not done.is_set()
    flush.finish()  # nothing is left


def test_slow_writes_are_one_episode_and_those_of_the_next_day_another_one() -> None:
    watch = DiskWatch(0.4, 2.0, 60.0)
    pushed = [watch.push(took, now) for now, took in enumerate([0.1, 0.5, 0.6, 0.1, 0.1, 0.1, 0.1, 0.9])]
    assert pushed == [None, True, None, None, None, False, None, True]
    assert watch.longest == 0.9
    busy = DiskWatch(0.4, 2.0, 60.0)
    hour = [busy.push(0.5 if now % 5 == 0 else 0.1, now) for now in range(3600)]
    assert 2 <= hour.count(True) <= 3  # one each 5 s without the rule
    assert [busy.push(0.1, 4000.0), busy.push(0.5, 8000.0), busy.push(0.1, 8003.0)] == [False, True, False]


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


def test_a_full_disk_refuses_garbage_is_a_bit_and_else_it_is_a_file(tmp_path: Path) -> None:
    made = Faulty(tmp_path, "wrong")
    assert made.write(math.nan) == PIECE  # before the run
    with pytest.raises(OSError, match="Errno") as refused:
        made.write(1.5)
    assert refused.value.errno == errno.ENOSPC
    assert made.write(2.0) == 2 * PIECE
    made.sink.sync()
    assert made.sink.tell() == 200
    made.sink.close()
    (tmp_path / "garbage").mkdir()
    got = Faulty(tmp_path / "garbage", "garbage").write(1.5)
    assert sum((one ^ other).bit_count() for one, other in zip(got, PIECE, strict=True)) == 1


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
