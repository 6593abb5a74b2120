# SPDX-License-Identifier: Apache-2.0
"""From blocks of samples to messages."""

from __future__ import annotations

import array
from dataclasses import dataclass

import numpy as np
from atpid_interfaces.msg import SampleBlock
from numpy.typing import NDArray

from atpid_common.nodes.messages import doubles, time_of


@dataclass(frozen=True)
class Layout:
    """What does not change from block to block."""

    frame_id: str
    rate: float
    """[Hz]."""
    channels: tuple[str, ...]
    units: tuple[str, ...]
    skew: tuple[float, ...]
    """[s]."""


def sample_block(
    layout: Layout, stamp_ns: int, first_index: int, values: NDArray[np.float64], dropped: int, backlog: int
) -> SampleBlock:
    """Return the message of (n_scans, n_channels) values in SI units."""
    message = SampleBlock(
        first_index=first_index,
        rate=layout.rate,
        dropped=dropped,
        backlog=backlog,
        channels=list(layout.channels),
        units=list(layout.units),
        skew=array.array("d", layout.skew),
        data=doubles(values),
    )
    message.header.stamp = time_of(stamp_ns)
    message.header.frame_id = layout.frame_id
    return message
