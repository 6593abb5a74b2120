# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The delay from a block's last sample to its command, minute by minute, read from a bag of a run in real time."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from atpid_common.latency import percentile
from atpid_control.runs.cdr import stamp
from atpid_control.runs.contents import Contents

_COMMAND = "atpid_interfaces/msg/CeilingCommand"
_MINUTE = 60_000_000_000  # [ns]


class Delay(NamedTuple):
    """One minute."""

    time: float  # begin, since the first command [s]
    median: float  # [s]
    p99: float  # [s]
    largest: float  # [s]


def delays(bag: Path) -> Iterator[Delay]:
    """Yield the delays of each minute: from a command's stamp, the block's last sample, to when it was recorded."""
    contents = Contents(bag)
    first, minute, values = 0, 0, list[float]()
    for channel, record in contents.records():
        if contents.types[channel.topic] == _COMMAND:
            sent = stamp(record.data)
            first = first or sent
            if (sent - first) // _MINUTE != minute and values:
                yield _of(minute, values)
                minute, values = (sent - first) // _MINUTE, []
            values.append((record.log_time - sent) * 1e-9)
    if values:
        yield _of(minute, values)


def _of(minute: int, values: list[float]) -> Delay:
    return Delay(60.0 * minute, percentile(values, 0.5), percentile(values, 0.99), max(values))
