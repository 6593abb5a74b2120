# SPDX-License-Identifier: Apache-2.0
"""The messages of a bag to play, by the definitions installed, and which blocks the loop answers."""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from atpid_control.bags.cdr import block_shape, header
from atpid_control.bags.decode import Converter
from atpid_control.bags.definitions import message_type
from atpid_control.bags.errors import BagError
from atpid_control.bags.read import Bag, Raw, open_bag
from atpid_control.bags.topics import BLOCK

#: The channel of the identifier: each block that has it is answered once.
_ANSWERED = "support_displacement"


@dataclass(frozen=True)
class Item:
    """One message to play."""

    topic: str
    time_ns: int  # log time [ns]
    data: bytes
    answer_ns: int | None  # stamp of the answer that follows: the block's last sample [ns]; None: no answer


@dataclass(frozen=True)
class Playback:
    """The messages to play in the order of their log times."""

    bag: Bag
    items: tuple[Item, ...]
    channels: dict[str, tuple[list[str], list[str]]]  # channels and units of each block topic
    notes: tuple[str, ...] = ()  # what was converted, a line for each message type

    @property
    def topics(self) -> dict[str, str]:
        """Message type of each topic played."""
        return {item.topic: self.bag.types[item.topic] for item in self.items}

    @property
    def start_ns(self) -> int:
        """Log time of the first message [ns]."""
        return self.items[0].time_ns

    @property
    def seconds(self) -> float:
        """From the first message to the last [s]."""
        return (self.items[-1].time_ns - self.start_ns) * 1e-9

    @property
    def last_stamp_ns(self) -> int:
        """Stamp of the last sample that is answered [ns]."""
        return max(item.answer_ns for item in self.items if item.answer_ns is not None)


def load_playback(path: Path, patterns: list[str]) -> Playback:
    """Read a bag and choose topics by `patterns` ("sensors/*", in any namespace).

    Messages recorded with an older definition are converted to the one installed. Raises BagError: no bag, nothing to
    play, no block the identifier would answer, or messages that cannot be converted.
    """
    bag = open_bag(path)
    chosen = [topic for topic in bag.types if any(_matches(topic, pattern) for pattern in patterns)]
    if not chosen:
        has = ", ".join(sorted(bag.types)) or "no messages"
        raise BagError(f"{path}: no topic fits {', '.join(patterns) or 'an empty list'}; the bag has {has}")
    converters = {kind: _converter(bag, kind) for kind in dict.fromkeys(bag.types[topic] for topic in chosen)}
    channels = _channels(bag, [topic for topic in chosen if bag.types[topic] == BLOCK])
    answered = {topic for topic, (names, _) in channels.items() if _ANSWERED in names}
    items = [_item(bag, raw, converters[bag.types[raw.topic]], answered) for raw in bag.raw if raw.topic in chosen]
    if not any(item.answer_ns is not None for item in items):
        raise BagError(
            f"{path}: no sensors topic with the channel {_ANSWERED}, so there is nothing to identify in this bag"
        )
    notes = (_conversion(bag, kind, converter) for kind, converter in converters.items() if converter)
    return Playback(bag, tuple(items), channels, tuple(notes))


def _item(bag: Bag, raw: Raw, converter: Converter | None, answered: set[str]) -> Item:
    data = converter.convert(bag.decode(raw)) if converter else raw.data
    return Item(raw.topic, raw.log_ns, data, _last_sample(data) if raw.topic in answered else None)


def _matches(topic: str, pattern: str) -> bool:
    return fnmatchcase(topic, f"*/{pattern.lstrip('/')}")


def _converter(bag: Bag, kind: str) -> Converter | None:
    """Return what converts messages of the type `kind`; None where they are played as they are."""
    recorded = {bag.hashes[topic] for topic, name in bag.types.items() if name == kind}
    if recorded == {message_type(kind).hash}:
        return None
    try:
        converter = bag.converter(kind)
    except BagError as error:
        commit = bag.run.get("commit", "unknown")
        raise BagError(f"{bag.path}: {error}; replay it with the version that recorded it ({commit})") from None
    return None if converter.identical else converter


def _conversion(bag: Bag, kind: str, converter: Converter) -> str:
    differences = [f"{field} is not in the bag and keeps its default" for field in converter.missing]
    differences += [f"{field} is left out" for field in converter.dropped]
    commit = bag.run.get("commit", "unknown")
    listed = "; ".join(differences) or "the fields stand in another order"
    return f"{kind} was recorded with another definition (version {commit}) and is converted: {listed}"


def _channels(bag: Bag, topics: list[str]) -> dict[str, tuple[list[str], list[str]]]:
    found: dict[str, tuple[list[str], list[str]]] = {}
    for topic in topics:
        _, first = next(bag.messages(topic), (0, None))
        if first is not None:
            found[topic] = (list(first.channels), list(first.units))
    return found


def _last_sample(data: bytes) -> int | None:
    shape, stamp = block_shape(data), header(data).stamp_ns
    return stamp + round((shape.scans - 1) / shape.rate * 1e9) if shape.scans else None
