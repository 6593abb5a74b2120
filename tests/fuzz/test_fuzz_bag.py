# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A small bag cut off anywhere: a clear result, whole chunks, the bag as it was; every byte with `make fuzz`."""

import shutil
import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from mutations import bag_of, records_of
from targets import BAG

from atpid_control.runs.errors import BagError
from atpid_control.runs.metadata import new_run
from atpid_control.runs.recover import recover
from atpid_control.runs.verify import survey, verify
from atpid_control.runs.writer import BagWriter

LONG = settings.get_current_profile_name() == "long"
#: Bytes between two cuts of the smallest bag and of the other.
LEAST_STEP, STEP = (1, 1) if LONG else (37, 151)
TOPICS = ("/sensors/laser", "/ceiling/command")


def four_each(folder: Path) -> Path:
    """Make a bag of two topics with four messages each, in five chunks; return its file."""
    folder.mkdir()
    found = records_of((BAG / "bag_0.mcap").read_bytes(), 4)
    channels = {one.id: one.schema_id for one in found if isinstance(one, Channel) and one.topic in TOPICS}
    kept: list[Any] = [one for one in found if isinstance(one, Schema) and one.id in channels.values()]
    kept += [one for one in found if isinstance(one, Channel) and one.id in channels]
    kept += [one for one in found if isinstance(one, Message) and one.channel_id in channels]
    (folder / "run_0.mcap").write_bytes(bag_of(kept, 300))
    return folder / "run_0.mcap"


def least(folder: Path) -> Path:
    """Make a bag of three messages of twelve bytes, in as many chunks, without metadata.yaml; return its file."""
    writer = BagWriter(folder, new_run(run_id="least", commit="none"))
    writer.add_topic("/t", "builtin_interfaces/msg/Time")
    for number in range(3):
        writer.write("/t", struct.pack("<IiI", 256, number, 0), number, number)
        writer.end_chunk()
    writer.close()
    (folder / "metadata.yaml").unlink()  # as where a recorder was killed
    return next(folder.glob("*.mcap"))


def outcome(folder: Path) -> int:
    """Verify, survey and recover a bag; return the messages recovered. Whatever is wrong is one line."""
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    again = folder.parent / "again"
    shutil.rmtree(again, ignore_errors=True)
    lines: list[str] = []
    with suppress(BagError):
        lines = survey(folder)
    refusals, messages = [], 0
    try:
        messages = verify(folder).messages
    except BagError as error:
        refusals.append(str(error))
        try:
            messages = recover(folder, again).verified.messages
        except BagError as other:
            refusals.append(str(other))
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert not [line for line in (*lines, *refusals) if "\n" in line or len(line) > 1000]
    assert len(refusals) < 2 or "bag" in refusals[1]  # its first bytes
    return messages


@pytest.mark.parametrize(("make", "step", "chunks"), [(least, LEAST_STEP, 3), (four_each, STEP, 5)])
def test_chunks_before_a_cut_are_there(make: Callable[[Path], Path], step: int, chunks: int, tmp_path: Path) -> None:
    file = make(tmp_path / "run")
    data = file.read_bytes()
    with file.open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        ends = sorted(one.chunk_start_offset + one.chunk_length for one in summary.chunk_indexes)
        messages = sum(1 for _ in reader.iter_messages(log_time_order=False))
    assert len(ends) == chunks
    # around the end of each chunk too, and around that of the file
    cuts = {*range(0, len(data), step), *(end + more for end in (*ends, len(data)) for more in (-1, 0, 1))}
    found = []
    for size in sorted(cut for cut in cuts if cut < len(data)):
        file.write_bytes(data[:size])
        found.append(outcome(file.parent))
        whole = sum(end <= size for end in ends)
        assert (found[-1] > 0) == (whole > 0), size
        assert found[-1] < messages or whole == len(ends), size
    assert found == sorted(found)
