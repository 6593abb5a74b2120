# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is left of a damaged bag: every whole chunk, what is lost by sample index, and the original as it was."""

import errno
import os
import re
import struct
import tracemalloc
from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import yaml
import zstandard
from mcap.reader import make_reader
from recorded import LASER, STATES, begin_bag, block, in_one_line, make, refused, write_bag
from rosbags.rosbag2 import Reader

from atpid_control.cli import main
from atpid_control.runs.errors import BagError
from atpid_control.runs.parts import MAGIC
from atpid_control.runs.read import open_bag
from atpid_control.runs.records import LARGEST_CHUNK, inside
from atpid_control.runs.recover import recover, repair
from atpid_control.runs.salvage import salvage
from atpid_control.runs.verify import verify
from atpid_control.runs.writer import Sink, Split

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


def test_a_bag_that_was_not_closed_names_its_last_scan_and_how_much_may_be_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = small(tmp_path / "run", close=False)
    found = recover(bag)
    assert found.verified.messages == 24
    assert "0.02 s" in found.lost[-2]
    assert found.lost[-1].startswith(f"{LASER}: ")
    assert found.lost[-1].endswith(" 59")
    assert main(["bag", "verify", str(bag)]) == 2
    assert f"lost: {found.lost[-1]}" in capsys.readouterr().out


def test_scans_lost_before_the_recorder_are_told_from_those_lost_in_the_file(tmp_path: Path) -> None:
    blocks = [(LASER, block(SCANS * number, np.zeros((SCANS, 2)))) for number in (0, 1, 3)]
    (line,) = verify(write_bag(tmp_path / "run", blocks)).lost
    assert line.startswith(f"{LASER}: scans 10 to 14 ")
    assert "before" in line


def test_public_readers_seek_in_a_recovered_bag(tmp_path: Path) -> None:
    made = recover(small(tmp_path / "run", close=False)).verified.folder
    with next(made.glob("*.mcap")).open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        late = [message.log_time for _, _, message in reader.iter_messages(topics=[LASER], starting_at=40_000_000)]
    assert summary is not None
    assert summary.chunk_indexes
    assert late == [40_000_000, 45_000_000, 50_000_000, 55_000_000]
    with Reader(made) as other:
        assert sum(1 for _ in other.messages(start=40_000_000)) == 8


def test_a_whole_bag_is_not_written_again(bag: Path) -> None:
    assert not recover(bag).made
    assert os.listdir(bag.parent) == ["run"]


def test_nothing_is_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = small(tmp_path / "run", close=False)
    (tmp_path / "run-recovered").mkdir()
    refused(capsys, ["bag", "recover", bag], "run-recovered", "exists")
    assert main(["bag", "recover", str(bag), "--out", str(tmp_path / "other")]) == 0
    assert f"lost: {LASER}: ends" in capsys.readouterr().out
    refused(capsys, ["bag", "verify", bag, "--out", tmp_path])


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
    tracemalloc.start()
    try:
        assert sum(1 for _ in inside(data)) == 20_000
        assert tracemalloc.get_traced_memory()[1] < len(data) + 100_000
    finally:
        tracemalloc.stop()


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


def test_a_crash_after_a_split_loses_the_last_chunk_alone(tmp_path: Path) -> None:
    bag = small(tmp_path / "run", split=THREE_FILES, close=False)
    assert repair(bag).verified.messages == 24
    assert sorted(file.name for file in bag.glob("*.mcap")) == ["run_0.mcap", "run_1.mcap", "run_2.mcap"]


def test_ten_files_are_read_in_their_order(tmp_path: Path) -> None:
    bag = small(tmp_path / "run", each=1, split=Split(seconds=0.005))
    assert len(list(bag.glob("*.mcap"))) == 12
    assert not verify(bag).lost


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
    recover(bag)
    assert verify(bag.with_name("run-recovered")).messages == 24
