# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reads what is whole in a damaged MCAP file: past a wrong checksum, a wrong length, a missing index or end."""

import re
import struct
import zlib
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap import records as mcap
from mcap.opcode import Opcode
from mcap.stream_reader import StreamReader

from atpid_control.runs.parts import MAGIC
from atpid_control.runs.records import BoundedFile, inside, unpacked

#: Of a file without an end.
NOT_CLOSED = "it was not closed"
_HEAD = struct.Struct("<BQ")  # opcode and length, before the contents of a record
_FOOTER = _HEAD.size + 20  # [bytes]
_CRC_SIZE = 4
#: A chunk's opcode, and a length below 2^40.
_CHUNK = re.compile(rb"\x06(?=.{5}\x00\x00\x00)", re.DOTALL)
_CHUNK_FIELDS = struct.Struct("<QQQII")  # begin, end, unpacked size, checksum, length of the compression's name
_COMPRESSIONS = (0, 3, 4)  # lengths of "", "lz4", "zstd"
_WINDOW = 2**20  # searched at once [bytes]
#: Bytes that records which turn out to be none may take in all, besides four times the file.
_WASTE = 2**26
#: Opcode and length of what follows the last data.
_ENDS = ((Opcode.DATA_END, 4), (Opcode.FOOTER, 20))
#: Records that are not read: where the data end, and what is found without them.
_LEFT = {Opcode.DATA_END, Opcode.FOOTER, Opcode.MESSAGE_INDEX, Opcode.SUMMARY_OFFSET}


@dataclass
class Damage(mcap.McapRecord):
    """A part of the file that is left out."""

    begin: int  # of its first byte
    end: int
    why: str


class _Summary(NamedTuple):
    """The end of a file that was closed."""

    records: list[mcap.McapRecord]
    places: list[int]  # where chunks, attachments and metadata begin, in their order
    begin: int


def salvage(file: Path) -> Iterator[mcap.McapRecord]:
    """Yield the records of a file that are whole, and a Damage for each part that is not.

    The schemas, channels and statistics of the index follow the header, where it is whole. Ends for any file: each step
    goes forward. Raises OSError.
    """
    with file.open("rb") as stream:
        begin = stream.read(len(MAGIC))
        if begin != MAGIC:
            yield Damage(0, len(begin), "it does not begin as an MCAP file does")
        yield from _Walk(stream).records()


class _Walk:
    """One pass over a damaged file."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._size = stream.seek(0, 2)
        self._waste = _WASTE + 4 * self._size

    def records(self) -> Iterator[mcap.McapRecord]:
        summary = self._summary()
        end = self._size
        places: list[int] = []
        indexed: list[mcap.McapRecord] = []
        if summary is not None:
            indexed = [one for one in summary.records if isinstance(one, (mcap.Schema, mcap.Channel, mcap.Statistics))]
            places, end = summary.places, summary.begin
        place = len(MAGIC)
        while place < end:
            if place > len(MAGIC):
                yield from indexed
                indexed = []
            opcode, length = self._head(place)
            after = place + _HEAD.size + length
            if (opcode, length) in _ENDS and after <= end and self._plausible(after, end):
                if summary is None:  # what follows is an index that cannot be used
                    yield Damage(after, end, "its index is damaged")
                return
            reason = "" if after <= end else "its length is beyond the end"
            if not reason:
                try:
                    yield from self._whole(place, opcode, length)
                except Exception as error:  # the library raises many types of errors for damaged bytes
                    reason = " ".join(str(error).split())[:120] or type(error).__name__
                    self._waste -= length
            if not reason:
                place = after
                continue
            following = after if after <= end and self._plausible(after, end) else self._next(place + 1, places, end)
            yield Damage(place, following, reason)
            place = following
        if summary is None:
            yield Damage(end, end, NOT_CLOSED)

    def _head(self, place: int) -> tuple[int, int]:
        """Return opcode and length of the record at `place`; a length beyond the file where there is none."""
        self._stream.seek(place)
        head = self._stream.read(_HEAD.size)
        return _HEAD.unpack(head) if len(head) == _HEAD.size else (0, self._size)

    def _plausible(self, place: int, end: int) -> bool:
        """Whether a record can begin at `place`, or the data end there."""
        opcode, length = self._head(place)
        return place >= end or (opcode in set(Opcode) and place + _HEAD.size + length <= self._size)

    def _whole(self, place: int, opcode: int, length: int) -> Iterator[mcap.McapRecord]:
        """Yield the record at `place`, those inside of a chunk. Raises an error where it is not whole."""
        if opcode not in set(Opcode):
            raise ValueError(f"{opcode} is no kind of record")
        if opcode in _LEFT:
            if opcode == Opcode.MESSAGE_INDEX and 6 + int.from_bytes(self._content(place, 6)[2:], "little") != length:
                raise ValueError("the index of a chunk's messages has a wrong length")
            return
        data = self._content(place, length)
        record = _parsed(opcode, data)
        if isinstance(record, mcap.Attachment):
            stored = int.from_bytes(data[-_CRC_SIZE:], "little")
            if stored not in (0, zlib.crc32(data[:-_CRC_SIZE])):
                raise ValueError(f"the file {record.name[:60]!r} kept in it is damaged")
        if isinstance(record, mcap.Chunk):
            contents = unpacked(record)
            if not record.uncompressed_crc:  # nothing else shows whether all of it is whole
                for _ in inside(contents):
                    pass
            yield from inside(contents)
        elif not isinstance(record, (mcap.ChunkIndex, mcap.AttachmentIndex, mcap.MetadataIndex, mcap.Statistics)):
            yield record

    def _content(self, place: int, length: int) -> bytes:
        """Return the first `length` bytes of the contents of the record at `place`."""
        self._stream.seek(place + _HEAD.size)
        return self._stream.read(length)

    def _next(self, place: int, places: list[int], end: int) -> int:
        """Return where the next record begins, by the index or else the next chunk that looks like one."""
        known = bisect_left(places, place)
        if known < len(places):
            return min(places[known], end)
        while place < end and self._waste > 0:
            self._stream.seek(place)
            window = self._stream.read(min(_WINDOW, end - place))
            for match in _CHUNK.finditer(window):
                if self._is_chunk(place + match.start(), end):
                    return place + match.start()
            self._waste -= len(window) // 16
            place += max(1, len(window) - _HEAD.size)
        return end

    def _is_chunk(self, place: int, end: int) -> bool:
        """Whether the lengths of a chunk at `place` agree with each other."""
        _, length = self._head(place)
        fields = self._stream.read(_CHUNK_FIELDS.size)
        if len(fields) < _CHUNK_FIELDS.size or place + _HEAD.size + length > end:
            return False
        name = _CHUNK_FIELDS.unpack(fields)[4]
        if name not in _COMPRESSIONS:
            return False
        rest = self._stream.read(name + 8)[name:]
        return bool(length == _CHUNK_FIELDS.size + name + 8 + int.from_bytes(rest, "little"))

    def _summary(self) -> _Summary | None:
        """Return the end of the file; None where it is missing or damaged."""
        tail = _FOOTER + len(MAGIC)
        try:
            self._stream.seek(max(0, self._size - tail))
            footer, magic = self._stream.read(_FOOTER), self._stream.read()
            opcode, length = _HEAD.unpack(footer[: _HEAD.size])
            begin, _, stored = struct.unpack("<QQI", footer[_HEAD.size :])
            if (opcode, length, magic) != (Opcode.FOOTER, 20, MAGIC) or not 0 < begin < self._size:
                return None
            self._stream.seek(begin)
            data = self._stream.read(self._size - tail - begin)
            if stored not in (0, zlib.crc32(footer[:-_CRC_SIZE], zlib.crc32(data))):
                return None
            return _Summary(*_index(data), begin)
        except Exception:  # of the library, for damaged bytes
            return None


def _index(data: bytes) -> tuple[list[mcap.McapRecord], list[int]]:
    """Return the records of an index, and where the records begin that it names."""
    found: list[mcap.McapRecord] = []
    places: list[int] = []
    at = 0
    while at < len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if opcode in set(Opcode) - _LEFT:
            record = _parsed(opcode, data[at : at + length])
            if isinstance(record, mcap.ChunkIndex):
                places.append(record.chunk_start_offset)
            elif isinstance(record, (mcap.AttachmentIndex, mcap.MetadataIndex)):
                places.append(record.offset)
            else:
                found.append(record)
        at += length
    return found, sorted(places)


def _parsed(opcode: int, data: bytes) -> mcap.McapRecord:
    """Return the record that `data` holds; raise an error where they are not of its kind."""
    content = BoundedFile(BytesIO(_HEAD.pack(opcode, len(data)) + data))
    reader = StreamReader(content, skip_magic=True, emit_chunks=True)  # type: ignore[arg-type]
    record: mcap.McapRecord = next(reader.records)
    return record
