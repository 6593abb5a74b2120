# SPDX-License-Identifier: Apache-2.0
"""Reads bags: messages decoded with the schemas inside them, so that neither ROS nor the workspace is needed."""

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain, repeat
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema

from atpid_common.message_checks import CHECKS, check_as
from atpid_control.bags.cut_off import Parts
from atpid_control.bags.decode import Decoder
from atpid_control.bags.errors import BagError
from atpid_control.bags.losses import scans_of, stamp_of
from atpid_control.bags.metadata import RESULT, RUN, SCENE
from atpid_control.bags.parts import check_listed, find_parts, read_metadata
from atpid_control.bags.records import records, renumbered
from atpid_control.bags.verify import channel_of

__all__ = ["MOST_HELD", "Bag", "Raw", "open_bag", "scans_of", "stamp_of"]

#: Longest gap between two blocks of one stream [s]: an index farther ahead is none.
_LONGEST_GAP = 3600.0
#: Memory of one message besides its bytes, and what all of them may take [bytes].
_RAW = 250
MOST_HELD = int(0.8 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))


@dataclass(frozen=True, slots=True)
class Raw:
    """One message as it is in the file."""

    topic: str
    log_ns: int
    publish_ns: int
    data: bytes


@dataclass
class Bag:
    """A bag in memory: serialised messages in the order of their log times, decoded on demand."""

    path: Path
    types: dict[str, str] = field(default_factory=dict)  # message type by topic
    hashes: dict[str, str] = field(default_factory=dict)  # type hash by topic
    run: dict[str, str] = field(default_factory=dict)  # run_id, commit, created, ...
    #: wall_s, data_s, real_time_factor, lost_scans ...; empty: not closed
    result: dict[str, str] = field(default_factory=dict)
    files: dict[str, bytes] = field(default_factory=dict)  # configuration, verbatim
    raw: list[Raw] = field(default_factory=list)
    decoder: Decoder = field(default_factory=Decoder)
    _schemas: dict[str, int] = field(default_factory=dict)
    #: Messages that cannot be used, which readers do not get: why, by topic and place in `raw`.
    left_out: dict[str, dict[int, str]] = field(default_factory=dict)
    #: What is not in a bag that was read as far as it goes, a line each.
    missing: list[str] = field(default_factory=list)

    @property
    def scene_text(self) -> str | None:
        """The scene the run was started with, None where none was recorded."""
        try:
            return self.files[SCENE].decode() if SCENE in self.files else None
        except UnicodeDecodeError:
            raise BagError(f"{self.path}: the scene kept in it is not text in UTF-8: it is damaged") from None

    def decode(self, raw: Raw) -> Any:
        """Return the message: fields by name, number sequences as arrays. Raises BagError."""
        return self.decoder.decode(self._schemas[raw.topic], raw.data)

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Yield (log time [ns], message) of one topic that can be used; nothing where the bag does not have it."""
        for _, log_ns, message in self._usable(topic):
            yield log_ns, message

    def stream(self, topic: str) -> Iterator[Any]:
        """Yield the blocks of samples of one topic, those of the first rate whose index goes on, at most an hour on."""
        following = rate = None
        for place, _, block in self._usable(topic):
            first = int(block.first_index)
            if following is None:
                rate = block.rate
            elif block.rate != rate or not following <= first <= following + _LONGEST_GAP * block.rate:
                reason = f"its index is {first} at {block.rate:g} Hz after {following - 1} at {rate:g} Hz"
                self.left_out.setdefault(topic, {})[place] = reason
                continue
            following = first + scans_of(block)
            yield block

    def _usable(self, topic: str) -> Iterator[tuple[int, int, Any]]:
        """Yield (place, log time [ns], message); count what cannot be used."""
        package, _, kind = self.types.get(topic, "").rpartition("/msg/")
        checked = package == "atpid_interfaces" and kind in CHECKS
        for place, raw in enumerate(self.raw):
            if raw.topic == topic:
                message = self.decode(raw)
                reason = check_as(kind, message) if checked else ""
                if reason:
                    self.left_out.setdefault(topic, {})[place] = reason
                else:
                    yield place, raw.log_ns, message

    def of_kind(self, kind: str) -> Iterator[tuple[int, Any]]:
        """Yield (log time [ns], message) of message type atpid_interfaces/msg/`kind`, topic by topic."""
        return chain.from_iterable(map(self.messages, self.topics_of(kind)))

    def topics_of(self, kind: str) -> list[str]:
        """Return the topics of message type atpid_interfaces/msg/`kind`, sorted."""
        return sorted(topic for topic, name in self.types.items() if name == f"atpid_interfaces/msg/{kind}")


def open_bag(path: Path | str, *, messages: bool = True, torn_ok: bool = False) -> Bag:
    """Read a bag, given as its folder or its .mcap file; without its `messages` in bounded memory.

    With `torn_ok` one that is not closed, cut off or damaged is read as far as it goes; `missing` then lists what is
    not there. Raises BagError: no bag; without `torn_ok` also not closed, or damaged.
    """
    path = Path(path)
    parts = Parts(path) if torn_ok else None
    files = find_parts(path) if parts is None else parts.files
    if parts is None and path.is_dir():
        check_listed(path, files, read_metadata(path))
    bag, channels, held = Bag(path), dict[int, Channel](), 0
    for place, file in enumerate(files):
        found = records(file) if parts is None else parts.records(file)
        for record in map(renumbered, found, repeat(place)):
            if isinstance(record, Message):
                topic = channel_of(record, channels).topic
                if messages:
                    bag.raw.append(Raw(topic, record.log_time, record.publish_time, record.data))
                    held = _within_memory(path, held + len(record.data) + _RAW)
            else:
                _describe(bag, record, channels)
    bag.raw.sort(key=lambda raw: raw.log_ns)
    _add_topics(bag, channels.values(), files[0])
    bag.missing = [] if parts is None else parts.missing
    return bag


def _within_memory(path: Path, held: int) -> int:
    """Return `held` [bytes]; raise BagError where this machine does not have as much."""
    if held > MOST_HELD:
        raise BagError(
            f"{path}: its messages take more than {MOST_HELD / 1e9:.1f} GB of memory, most of what this machine has; "
            "`check` and `extract` read it with little"
        )
    return held


def _describe(bag: Bag, record: McapRecord, channels: dict[int, Channel]) -> None:
    """Take a record that is no message."""
    if isinstance(record, Schema):
        bag.decoder.add(record)
    elif isinstance(record, Channel) and record.id not in channels:
        channels[record.id] = record
    elif isinstance(record, Attachment):
        bag.files[record.name] = record.data
    elif isinstance(record, Metadata):
        {RUN: bag.run, RESULT: bag.result}.get(record.name, {}).update(record.metadata)


def _add_topics(bag: Bag, channels: Iterable[Channel], file: Path) -> None:
    """Take the types of the topics; raise BagError where messages cannot be decoded."""
    for channel in channels:
        if channel.message_encoding != "cdr" or channel.schema_id == 0:
            given = f"{file}: {channel.topic} is encoded as {channel.message_encoding!r}"
            raise BagError(f"{given}; allowed: cdr with its definition, as recorder_node writes it")
        bag._schemas[channel.topic] = channel.schema_id
        bag.types[channel.topic] = bag.decoder.name(channel.schema_id)
        bag.hashes[channel.topic] = channel.metadata.get("topic_type_hash", "")
