# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag whose index leads to fewer messages than it holds: other programs read by it, and would miss them unnoticed."""

import struct
from pathlib import Path

import numpy as np
import pytest
from recorded import block

from atpid_control.runs.errors import BagError
from atpid_control.runs.metadata import new_run
from atpid_control.runs.recover import recover
from atpid_control.runs.verify import verify
from atpid_control.runs.writer import BagWriter

LASER, BLOCKS = "/sensors/laser", 6
CHUNK_INDEX, FOOTER = 0x08, 0x02
MAGIC = b"\x89MCAP0\r\n"


def without_a_chunk_in_the_index(file: Path) -> None:
    """Leave one chunk out of the file's index, as a writer with a defect does; all records stay whole."""
    content = file.read_bytes()
    summary, offsets, _ = struct.unpack_from("<QQI", content, len(content) - len(MAGIC) - 20)
    records, at = [], summary
    while at < offsets:
        opcode, length = struct.unpack_from("<BQ", content, at)
        records.append((opcode, content[at : at + 9 + length]))
        at += 9 + length
    records.remove(next(record for record in records if record[0] == CHUNK_INDEX))
    kept = b"".join(record for _, record in records)
    file.write_bytes(content[:summary] + kept + struct.pack("<BQQQI", FOOTER, 20, summary, 0, 0) + MAGIC)


def test_what_the_index_does_not_lead_to_is_no_whole_bag_and_recover_leads_to_it_again(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag", new_run(run_id="index", commit="none"))
    writer.add_topic(LASER, "atpid_interfaces/msg/SampleBlock")
    for number in range(BLOCKS):
        writer.write(LASER, block(5 * number, np.zeros((5, 2))), 5_000_000 * number, 5_000_000 * number)
        writer.end_chunk()
    writer.close({"finished": "yes"})
    assert verify(tmp_path / "bag").messages == BLOCKS
    without_a_chunk_in_the_index(next((tmp_path / "bag").glob("*.mcap")))
    with pytest.raises(BagError, match=r"its index leads to 5 of 6 messages; `atpid bag recover` writes it anew"):
        verify(tmp_path / "bag")
    recover(tmp_path / "bag")
    assert verify(tmp_path / "bag-recovered").messages == BLOCKS
