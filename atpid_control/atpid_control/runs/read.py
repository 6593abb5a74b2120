# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reads bags: messages decoded with the schemas inside them, so that neither ROS nor the workspace is needed."""

import os
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from mcap.records import Attachment, Channel, DataEnd, Footer, Message, Metadata, Schema

from atpid_common.message_checks import CHECKS, check_as
from atpid_control.runs.decode import Decoded, Decoder, is_handshake, scans_of, stamp_of
from atpid_control.runs.errors import BagError
from atpid_control.runs.metadata import FILE_NAME, RESULT, RUN, SCENE
from atpid_control.runs.parts import Listed, check_listed, find_parts, read_metadata
from atpid_control.runs.records import channel_of, records, renumbered

_OURS = "atpid_interfaces/msg/"


class Contents:
    """One pass over the files of a bag: what it holds besides its messages is known when `records` has yielded them."""

    def __init__(self, path: Path | str, torn_ok: bool = True) -> None:
        """Find the files of the bag, given as its folder or one file.

        With `torn_ok` one that is not closed, cut off or damaged is read as far as it goes. Raises BagError: no bag, or
        not the files that metadata.yaml lists; without `torn_ok` also not closed.
        """
        self.path = Path(path)
        self.decoder = Decoder()
        self.types: dict[str, str] = {}  # message type by topic
        self.hashes: dict[str, str] = {}  # type hash by topic
        self.run: dict[str, str] = {}  # run_id, commit, created, ...
        #: wall_s, data_s, real_time_factor, lost_scans ...; empty: not closed
        self.result: dict[str, str] = {}
        self.files: dict[str, bytes] = {}  # configuration, verbatim
        self._torn_ok, self._parts = torn_ok, find_parts(self.path)
        self._listed = Listed(set(), {}, None)
        self._torn: list[str] = []
        self._foreign: dict[str, str] = {}  # topics that cannot be read: why
        self._handshakes: set[str] = set()  # topics that may have them: another program records them as well
        self._counts = Counter[str]()  # messages by topic
        self._blocks: dict[str, tuple[int, bytes]] = {}  # the last of each topic in a file: definition and contents
        self._start_ns: int | None = None  # stamp of the first sample
        if self.path.is_dir() and (not torn_ok or (self.path / FILE_NAME).is_file()):
            try:
                self._listed = read_metadata(self.path)
            except BagError as error:
                if not torn_ok:
                    raise
                self._torn.append(str(error))
            else:
                check_listed(self.path, self._parts, self._listed)

    @property
    def scene_text(self) -> str | None:
        """The scene the run was started with, None where none was recorded."""
        try:
            return self.files[SCENE].decode() if SCENE in self.files else None
        except UnicodeDecodeError:
            raise BagError(f"{self.path}: the scene kept in it is not text in UTF-8: it is damaged") from None

    @property
    def unread(self) -> list[str]:
        """What is not in the bag and should be, and topics that cannot be read, a line each."""
        lines = [f"{self.path}: {topic}: {why}" for topic, why in self._foreign.items()]
        return [*self._cut_off(), *lines] if self._torn_ok else lines

    def _cut_off(self) -> Iterator[str]:
        yield from self._torn
        kept = self._listed.custom
        lost = kept.get("lost", "nothing") if isinstance(kept, dict) else "nothing"
        if lost != "nothing":
            yield f"{self.path}: recovered from a damaged bag, of which is lost: {lost}"
        elif not self._torn and self.run and not self.result:
            yield f"{self.path}: the recording was not closed: what was not written yet is not there"
        for name, count in self._listed.counts.items():
            if short := max(0, count - self._counts[name]):
                yield f"{self.path}: {name}: {short} of {count} messages that metadata.yaml lists are missing"

    def records(self) -> Iterator[tuple[Channel, Message]]:
        """Yield the messages that can be decoded, each with its channel, but no handshake, which carries nothing.

        Raises BagError where the bag is damaged.
        """
        channels: dict[int, Channel] = {}
        for place, file in enumerate(self._parts):
            ends, before = set[type](), self._counts.total()
            self._blocks = {}
            for record in records(file, self._torn_ok):
                renumbered(record, place)
                if isinstance(record, Message):
                    channel = channel_of(record, channels)
                    self._count(channel, record)
                    topic = channel.topic
                    if topic in self.types and not (topic in self._handshakes and is_handshake(record.data)):
                        yield channel, record
                elif isinstance(record, Schema):
                    with suppress(BagError):  # of another program: its topics are left out
                        self.decoder.add(record)
                elif isinstance(record, Channel) and record.id not in channels:
                    channels[record.id] = record
                    self._describe(record)
                elif isinstance(record, Attachment):
                    self.files[record.name] = record.data
                elif isinstance(record, Metadata):
                    {RUN: self.run, RESULT: self.result}.get(record.name, {}).update(record.metadata)
                ends.add(type(record))
            if self._torn_ok and Footer not in ends:
                ending = self._ending(self._counts.total() - before, DataEnd in ends)
                self._torn.append(f"{file}: {ending}; `atpid bag recover {self.path}` writes a whole bag")

    def _describe(self, channel: Channel) -> None:
        """Take the type of a topic; one whose messages cannot be decoded is left out."""
        try:
            kind = self.decoder.name(channel.schema_id)
        except BagError:
            kind = ""
        if channel.message_encoding == "cdr" and kind:
            self.types[channel.topic] = kind
            if list(self.decoder.fields(kind, channel.schema_id))[:2] == ["header", "handshake"]:
                self._handshakes.add(channel.topic)
            self.hashes[channel.topic] = channel.metadata.get("topic_type_hash", "")
        else:
            given = channel.message_encoding
            why = f"encoded as {given!r}" if given != "cdr" else "without a definition in ros2msg that can be read"
            self._foreign[channel.topic] = f"left out, {why}"

    def _count(self, channel: Channel, message: Message) -> None:
        """Count a message; of samples the last block is kept, which is decoded only where the file breaks off."""
        self._counts[channel.topic] += 1
        if self._torn_ok and kind_of(self.types.get(channel.topic, "")) == "SampleBlock":
            self._blocks[channel.topic] = channel.schema_id, message.data
            if self._start_ns is None and (block := self._block(*self._blocks[channel.topic])):
                self._start_ns = stamp_of(block)

    def _ending(self, messages: int, complete: bool) -> str:
        """Return where a file of so many messages ends, in words; `complete`: only its index is missing."""
        if complete:
            return "its index is cut off, every message is there"
        decoded = {topic: self._block(*block) for topic, block in sorted(self._blocks.items())}
        last = {topic: block for topic, block in decoded.items() if block is not None and block.rate > 0.0}
        if not last or self._start_ns is None:
            return f"cut off or damaged before its first sample: {messages} messages read"
        end = max(stamp_of(block) + round(scans_of(block) / block.rate * 1e9) for block in last.values())
        samples = [f"{int(block.first_index) + scans_of(block) - 1} of {topic}" for topic, block in last.items()]
        after = (end - self._start_ns) * 1e-9
        return f"cut off or damaged after {after:.6g} s: read until sample {', '.join(samples)}"

    def _block(self, schema: int, data: bytes) -> Decoded:
        """Return a block; None where it cannot be used, or has no samples."""
        with suppress(BagError):
            block = self.decoder.decode(schema, data)
            return block if len(block.channels) and len(block.data) else None
        return None


def kind_of(name: str) -> str:
    """Return the message of "atpid_interfaces/msg/Message"; empty: a type of another package."""
    return name.removeprefix(_OURS) if name.startswith(_OURS) else ""


def reason_to_leave_out(kind: str, message: Decoded) -> str:
    """Return why a message of atpid_interfaces/msg/`kind` cannot be used; empty: it can, or is of another package."""
    return check_as(kind, message) if kind in CHECKS else ""


#: Memory of one message besides its bytes, and what all of them may take [bytes].
_RAW = 250
MOST_HELD = int(0.8 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))


@dataclass(frozen=True, slots=True)
class _Raw:
    """One message as it is in the file."""

    topic: str
    log_ns: int
    publish_ns: int
    data: bytes
    schema: int = 0  # of the bag's decoder


class Bag(Contents):
    """A bag in memory: serialised messages in the order of their log times, decoded on demand."""

    def __init__(self, path: Path | str, torn_ok: bool = False) -> None:
        """Find the files; `open_bag` fills it. Raises BagError."""
        super().__init__(path, torn_ok)
        self.raw: list[_Raw] = []
        #: Messages that cannot be used, which readers do not get: why, by topic and place in `raw`.
        self.left_out: dict[str, dict[int, str]] = {}

    def decode(self, raw: _Raw) -> Decoded:
        """Return the message: fields by name, number sequences as arrays. Raises BagError."""
        return self.decoder.decode(raw.schema, raw.data)

    def messages(self, topic: str) -> Iterator[tuple[int, Decoded]]:
        """Yield (log time [ns], message) of one topic that can be used; nothing where the bag does not have it."""
        kind = kind_of(self.types.get(topic, ""))
        for place, raw in enumerate(self.raw):
            if raw.topic == topic:
                message = self.decode(raw)
                reason = reason_to_leave_out(kind, message)
                if reason:
                    self.left_out.setdefault(topic, {})[place] = reason
                else:
                    yield raw.log_ns, message

    @property
    def missing(self) -> list[str]:
        """What is not in the bag, or was read and cannot be used, a line each."""
        left_out = ((topic, len(why), next(iter(why.values()))) for topic, why in sorted(self.left_out.items()))
        unused = (f"{topic}: {count} messages left out, the first since {why}" for topic, count, why in left_out)
        return [*self.unread, *(f"{self.path}: {line}" for line in unused)]

    def of_kind(self, kind: str) -> Iterator[tuple[int, Decoded]]:
        """Yield (log time [ns], message) of message type atpid_interfaces/msg/`kind`, topic by topic."""
        return chain.from_iterable(map(self.messages, self.topics_of(kind)))

    def topics_of(self, kind: str) -> list[str]:
        """Return the topics of message type atpid_interfaces/msg/`kind`, sorted."""
        return sorted(topic for topic, name in self.types.items() if kind_of(name) == kind)


def open_bag(path: Path | str, *, messages: bool = True, torn_ok: bool = False) -> Bag:
    """Read a bag, given as its folder or one file; without its `messages` in bounded memory.

    With `torn_ok` one that is not closed, cut off or damaged is read as far as it goes; `missing` then lists what is
    not there. Raises BagError: no bag; without `torn_ok` also not closed, or damaged.
    """
    bag, held = Bag(path, torn_ok), 0
    for channel, record in bag.records():
        if messages:
            times = record.log_time, record.publish_time
            bag.raw.append(_Raw(channel.topic, *times, record.data, channel.schema_id))
            held = within_memory(bag.path, held + len(record.data) + _RAW)
    bag.raw.sort(key=lambda raw: raw.log_ns)
    return bag


def within_memory(path: Path, held: int) -> int:
    """Return `held` [bytes]; raise BagError where this machine does not have as much."""
    if held > MOST_HELD:
        raise BagError(
            f"{path}: its messages take more than {MOST_HELD / 1e9:.1f} GB of memory, most of what this machine has; "
            "`atpid bag check`, `export` and `extract` read it with little, and --from and --to choose a part"
        )
    return held
