# SPDX-License-Identifier: Apache-2.0
"""Reads bags: messages decoded with the schemas inside them, so that neither ROS nor the workspace is needed."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel, Message, Metadata, Schema

from atpid_common.message_checks import CHECKS, check_as
from atpid_control.bags import metadata
from atpid_control.bags.decode import Decoder
from atpid_control.bags.errors import BagError
from atpid_control.bags.metadata import RESULT, RUN, SCENE
from atpid_control.bags.verify import channel_of, find_file, records

#: Longest gap between two blocks of one stream [s]: an index farther ahead is none.
_LONGEST_GAP = 3600.0


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


def stamp_of(message: Any) -> int:
    """Return the stamp in the header of a decoded message [ns]."""
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def scans_of(block: Any) -> int:
    """Return how many scans a SampleBlock or PlantTruth has."""
    return len(block.beam) if hasattr(block, "beam") else len(block.data) // len(block.channels)


def open_bag(path: Path | str, *, messages: bool = True) -> Bag:
    """Read a bag, given as its folder or its .mcap file; without its `messages` in bounded memory.

    Raises BagError: no bag, not closed, or damaged.
    """
    path = Path(path)
    file = find_file(path)
    if path.is_dir() and not (path / metadata.FILE_NAME).is_file():
        repair = f"`python -m atpid_control.recording repair {path}` makes it whole"
        raise BagError(f"{path}: {metadata.FILE_NAME} is missing, so the recording was not closed; {repair}")
    bag, channels = Bag(path), dict[int, Channel]()
    for record in records(file):
        if isinstance(record, Message):
            topic = channel_of(record, channels).topic
            if messages:
                bag.raw.append(Raw(topic, record.log_time, record.publish_time, record.data))
        elif isinstance(record, Schema):
            bag.decoder.add(record)
        elif isinstance(record, Channel) and record.id not in channels:
            channels[record.id] = record
        elif isinstance(record, Attachment):
            bag.files[record.name] = record.data
        elif isinstance(record, Metadata):
            {RUN: bag.run, RESULT: bag.result}.get(record.name, {}).update(record.metadata)
    bag.raw.sort(key=lambda raw: raw.log_ns)
    _add_topics(bag, channels.values(), file)
    return bag


def _add_topics(bag: Bag, channels: Iterable[Channel], file: Path) -> None:
    """Take the types of the topics; raise BagError where messages cannot be decoded."""
    for channel in channels:
        if channel.message_encoding != "cdr" or channel.schema_id == 0:
            given = f"{file}: {channel.topic} is encoded as {channel.message_encoding!r}"
            raise BagError(f"{given}; allowed: cdr with its definition, as recorder_node writes it")
        bag._schemas[channel.topic] = channel.schema_id
        bag.types[channel.topic] = bag.decoder.name(channel.schema_id)
        bag.hashes[channel.topic] = channel.metadata.get("topic_type_hash", "")
