# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is left of a damaged bag: every whole chunk, what is lost by sample index, and the original as it was."""

import errno
import os
import struct
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
import zstandard
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from recorded import block, make
from rosbags.rosbag2 import Reader

from atpid_control.cli import main
from atpid_control.runs.errors import BagError
from atpid_control.runs.metadata import new_run
from atpid_control.runs.read import open_bag
from atpid_control.runs.records import LARGEST_CHUNK, inside
from atpid_control.runs.recover import recover, repair
from atpid_control.runs.salvage import salvage
from atpid_control.runs.verify import verify
from atpid_control.runs.writer import BagWriter, Sink, Split

LASER, STATES = "/sensors/laser", "/ceiling/state"
SCANS = 5


def small(folder: Path, *, blocks: int = 12, close: bool = True, each: int = 2, split: Split | None = None) -> Path:
    """Write a bag of blocks of 5 scans, one state with each, `each` blocks to a chunk; return its folder."""
    run = new_run(run_id="small", commit="none", chunk_period="0.02")
    writer = BagWriter(folder, run, split=split)
    writer.add_topic(LASER, "atpid_interfaces/msg/SampleBlock")
    writer.add_topic(STATES, "atpid_interfaces/msg/CeilingState")
    noise = np.random.default_rng(1)
    for number in range(blocks):
        stamp = 5_000_000 * number
        writer.write(LASER, block(SCANS * number, noise.normal(size=(SCANS, 2))), stamp, stamp)
        writer.write(STATES, make("CeilingState", stamp, "motor_node"), stamp, stamp)
        if number % each == each - 1:
            writer.end_chunk()
    if close:
        writer.close({"finished": "yes"})
    else:
        writer.end_chunk()
        writer._sink.close()
    return folder


def chunk_places(file: Path) -> list[tuple[int, int]]:
    """Return where each chunk's record begins and ends."""
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    return [(one.chunk_start_offset, one.chunk_start_offset + one.chunk_length) for one in summary.chunk_indexes]


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_chunk_with_a_wrong_checksum_costs_that_chunk_and_is_named_by_index(tmp_path: Path) -> None:
    bag = small(tmp_path / "run")
    file = bag / "run_0.mcap"
    begin, end = chunk_places(file)[2]
    data = bytearray(file.read_bytes())
    data[begin + 9 + 24] ^= 1  # of the checksum
    file.write_bytes(data)
    found = recover(bag)
    assert found.verified.folder == tmp_path / "run-recovered"
    assert found.verified.messages == 20
    assert found.lost == [
        f"run_0.mcap, bytes {begin} to {end - 1}: a chunk does not have its checksum",
        f"{STATES}: messages 4 to 5 lost (2)",
        f"{LASER}: scans 20 to 29 lost (10)",
    ]
    assert list(verify(tmp_path / "run-recovered").lost) == found.lost[1:]
    stated = yaml.safe_load((tmp_path / "run-recovered/metadata.yaml").read_text())
    assert "scans 20 to 29 lost" in stated["rosbag2_bagfile_information"]["custom_data"]["lost"]


@pytest.mark.parametrize("length", [0, 1, 2**31, 2**40, 2**63, 2**64 - 1])
def test_after_an_absurd_length_the_next_chunk_is_found(tmp_path: Path, length: int) -> None:
    for close in (True, False):
        bag = small(tmp_path / f"run{close}")
        file = bag / f"run{close}_0.mcap"
        begin, _ = chunk_places(file)[1]
        data = bytearray(file.read_bytes())
        data[begin + 1 : begin + 9] = struct.pack("<Q", length)
        file.write_bytes(data if close else data[: chunk_places(bag / file.name)[-1][1]] if close else data[:-200])
        found = recover(bag)
        assert found.verified.messages == 20
        assert f"{LASER}: scans 10 to 19 lost (10)" in found.lost


def test_the_tail_of_a_closed_bag_is_counted(tmp_path: Path) -> None:
    bag = small(tmp_path / "run")
    file = bag / "run_0.mcap"
    os.truncate(file, chunk_places(file)[4][0] + 30)
    found = recover(bag)
    assert found.verified.messages == 16
    assert f"{LASER}: messages 8 to 11 lost (4), the last: every scan from 40 on" in found.lost
    assert f"{STATES}: messages 8 to 11 lost (4), the last" in found.lost


def test_a_bag_that_was_not_closed_names_its_last_scan_and_how_much_may_be_missing(tmp_path: Path) -> None:
    found = recover(small(tmp_path / "run", close=False))
    assert found.verified.messages == 24
    assert found.lost[-2:] == [
        "what the recorder had received and not yet written, as a rule 0.02 s at most",
        f"{LASER}: ends with scan 59",
    ]


def test_scans_lost_before_the_recorder_are_told_from_those_lost_in_the_file(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "run", new_run(run_id="small", commit="none"))
    writer.add_topic(LASER, "atpid_interfaces/msg/SampleBlock")
    for number in (0, 1, 3):
        writer.write(LASER, block(SCANS * number, np.zeros((SCANS, 2))), number, number)
    writer.close()
    assert verify(tmp_path / "run").lost == (f"{LASER}: scans 10 to 14 lost before the recorder (5)",)


def test_public_readers_seek_in_a_recovered_bag(tmp_path: Path) -> None:
    bag = small(tmp_path / "run", close=False)
    made = recover(bag).verified.folder
    with next(made.glob("*.mcap")).open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        late = [message.log_time for _, _, message in reader.iter_messages(topics=[LASER], starting_at=40_000_000)]
    assert summary is not None
    assert summary.chunk_indexes
    assert late == [40_000_000, 45_000_000, 50_000_000, 55_000_000]
    with Reader(made) as other:
        assert sum(1 for _ in other.messages(start=40_000_000)) == 8


def test_a_whole_bag_is_not_written_again(tmp_path: Path) -> None:
    bag = small(tmp_path / "run")
    assert not recover(bag).made
    assert os.listdir(tmp_path) == ["run"]


def test_nothing_is_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = small(tmp_path / "run", close=False)
    (tmp_path / "run-recovered").mkdir()
    assert main(["bag", "recover", str(bag)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["bag", "recover", str(bag), "--out", str(tmp_path / "other")]) == 0
    printed = capsys.readouterr().out
    assert f"lost: {LASER}: ends with scan 59" in printed
    assert "every one read and decoded" in printed
    assert main(["bag", "verify", str(bag)]) == 2
    assert f"lost: {LASER}: ends with scan 59" in capsys.readouterr().out
    assert main(["bag", "verify", str(bag), "--out", str(tmp_path)]) == 2


@pytest.mark.parametrize("write", [recover, repair])
def test_a_full_disk_leaves_nothing_of_a_recovery(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write: Callable[[Path], object]
) -> None:
    bag = small(tmp_path / "run", close=False)
    before = contents(tmp_path)

    def full(_file: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(BagError, match="the disk is full: free some space") as caught:
        write(bag)
    assert "\n" not in str(caught.value)
    assert contents(tmp_path) == before
    assert not list(tmp_path.rglob("*.partial"))


def with_chunk(file: Path, data: bytes, stated: int, compression: str) -> None:
    """Put a chunk of this content in the place of the second."""
    begin, end = chunk_places(file)[1]
    name = compression.encode()
    body = struct.pack("<QQQII", 0, 1, stated, 0, len(name)) + name + struct.pack("<Q", len(data)) + data
    whole = file.read_bytes()
    file.write_bytes(whole[:begin] + struct.pack("<BQ", 6, len(body)) + body + whole[end:])


@pytest.mark.parametrize("stated", [100, 2**20, LARGEST_CHUNK + 1, 2**63])
@pytest.mark.parametrize("compression", ["zstd", "lz4", "", "gzip"])
def test_a_decompression_bomb_is_left_out(tmp_path: Path, stated: int, compression: str) -> None:
    bag = small(tmp_path / "run")
    file = bag / "run_0.mcap"
    with_chunk(file, zstandard.ZstdCompressor().compress(bytes(2**24)), stated, compression)
    with pytest.raises(BagError, match="breaks off or is damaged"):
        verify(bag)
    assert recover(bag).verified.messages == 20


def test_a_chunk_of_many_records_takes_no_memory_for_all() -> None:
    data = struct.pack("<BQHIQQ", 5, 22, 1, 0, 0, 0) * 20_000
    tracemalloc.start()
    try:
        assert sum(1 for _ in inside(data)) == 20_000
        assert tracemalloc.get_traced_memory()[1] < len(data) + 100_000
    finally:
        tracemalloc.stop()


def test_a_split_bag_is_one_bag_to_every_reader(tmp_path: Path) -> None:
    whole = small(tmp_path / "whole")
    bag = small(tmp_path / "run", split=Split(seconds=0.02))
    files = sorted(file.name for file in bag.glob("*.mcap"))
    assert files == ["run_0.mcap", "run_1.mcap", "run_2.mcap"]
    information = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert information["relative_file_paths"] == files
    assert [entry["message_count"] for entry in information["files"]] == [8, 8, 8]
    assert [entry["starting_time"]["nanoseconds_since_epoch"] for entry in information["files"]] == [
        0,
        2 * 10**7,
        4 * 10**7,
    ]
    assert verify(bag).by_topic == verify(whole).by_topic
    assert not verify(bag).lost
    ours, theirs = open_bag(bag), open_bag(whole)
    assert [(raw.topic, raw.log_ns, raw.data) for raw in ours.raw] == [
        (raw.topic, raw.log_ns, raw.data) for raw in theirs.raw
    ]
    assert ours.types == theirs.types
    assert ours.result == {"finished": "yes"}
    with Reader(bag) as reader:
        assert reader.message_count == sum(1 for _ in reader.messages()) == 24
    for file in bag.glob("*.mcap"):  # each can be read alone
        assert open_bag(file).run["run_id"] == "small"


def test_a_file_of_a_split_bag_that_is_missing_is_named(tmp_path: Path) -> None:
    bag = small(tmp_path / "run", split=Split(size=1500))
    files = sorted(bag.glob("*.mcap"))
    assert len(files) > 2
    files[1].rename(tmp_path / "elsewhere.mcap")
    for read in (verify, open_bag):
        with pytest.raises(BagError, match=r"run_1\.mcap, which metadata\.yaml lists, is missing"):
            read(bag)
    found = recover(bag)
    assert any(line.startswith(f"{LASER}: scans ") for line in found.lost)
    assert verify(found.verified.folder).messages < 24


def test_ten_files_are_read_in_their_order(tmp_path: Path) -> None:
    bag = small(tmp_path / "run", blocks=12, each=1, split=Split(seconds=0.005))
    assert len(list(bag.glob("*.mcap"))) == 12
    assert not verify(bag).lost


def test_a_crash_after_a_split_loses_the_last_chunk_alone(tmp_path: Path) -> None:
    bag = small(tmp_path / "run", split=Split(seconds=0.02), close=False)
    found = repair(bag)
    assert found.verified.messages == 24
    assert sorted(file.name for file in bag.glob("*.mcap")) == ["run_0.mcap", "run_1.mcap", "run_2.mcap"]


def test_the_disk_that_fills_up_at_a_split_is_one_line(tmp_path: Path) -> None:
    class Second(Sink):
        def __init__(self, path: Path) -> None:
            if path.name != "run_0.mcap":
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            super().__init__(path)

    writer = BagWriter(tmp_path / "run", new_run(run_id="small", commit="none"), sink=Second, split=Split(seconds=0.01))
    writer.add_topic(STATES, "atpid_interfaces/msg/CeilingState")
    writer.write(STATES, make("CeilingState"), 0, 0)
    with pytest.raises(BagError, match="the disk is full"):
        writer.write(STATES, make("CeilingState"), 10**8, 10**8)
    assert recover(tmp_path / "run").verified.messages == 1


def test_every_step_of_a_salvage_goes_forward(tmp_path: Path) -> None:
    file = tmp_path / "x.mcap"
    for piece in (b"\x06", b"\x06" + bytes(8), struct.pack("<BQQQQII", 6, 40, 0, 0, 0, 0, 0) + bytes(8), b"\x05" * 9):
        file.write_bytes(b"\x89MCAP0\r\n" + piece * 3000)
        assert sum(1 for _ in salvage(file)) < 3010


def test_the_chunks_hold_what_the_library_reads(tmp_path: Path) -> None:
    with (small(tmp_path / "run") / "run_0.mcap").open("rb") as stream:
        chunks = [one for one in StreamReader(stream, emit_chunks=True).records if isinstance(one, Chunk)]
    assert len(chunks) == 6
    assert all(
        zlib.crc32(zstandard.decompress(one.data, one.uncompressed_size)) == one.uncompressed_crc for one in chunks
    )
