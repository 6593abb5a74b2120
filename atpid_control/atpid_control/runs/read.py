# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reads bags: messages decoded with the schemas inside them, so that neither ROS nor the workspace is needed."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from atpid_control.runs.contents import Contents, kind_of, reason_to_leave_out
from atpid_control.runs.errors import BagError

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
    schema: int = 0  # of the bag's decoder


class Bag(Contents):
    """A bag in memory: serialised messages in the order of their log times, decoded on demand."""

    def __init__(self, path: Path | str, torn_ok: bool = False) -> None:
        """Find the files; `open_bag` fills it. Raises BagError."""
        super().__init__(path, torn_ok)
        self.raw: list[Raw] = []
        #: Messages that cannot be used, which readers do not get: why, by topic and place in `raw`.
        self.left_out: dict[str, dict[int, str]] = {}

    def decode(self, raw: Raw) -> Any:
        """Return the message: fields by name, number sequences as arrays. Raises BagError."""
        return self.decoder.decode(raw.schema, raw.data)

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
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
        unused = (f"{self.path}: {topic}: {len(why)} messages left out, the first since {next(iter(why.values()))}"
                  for topic, why in sorted(self.left_out.items()))  # fmt: skip
        return [*self.unread, *unused]

    def of_kind(self, kind: str) -> Iterator[tuple[int, Any]]:
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
            bag.raw.append(Raw(channel.topic, *times, record.data, channel.schema_id))
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
