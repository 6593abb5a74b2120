# SPDX-License-Identifier: Apache-2.0
"""The support's motion in a bag, as a series a scene's `excitation.series` takes."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from atpid_control.bags.errors import BagError, in_words
from atpid_control.bags.read import Bag
from atpid_sim.system import Array

#: Channel with the support's displacement, and the columns written: those a scene takes.
CHANNEL, COLUMNS = "support_displacement", ("time", "support_displacement")
FILE_NAME = "support.csv"


def support_series(bag: Bag, begin: float = 0.0, end: float = math.inf) -> tuple[Array, Array]:
    """Return times (n,) since the first scan [s] and the support's displacements (n,) [m], from `begin` to `end` [s].

    Times are index / rate: stamps jitter, indices prove that nothing is missing. Raises BagError: no such channel, or
    scans that are lost, invalid or of two streams in between.
    """
    topic, blocks = _blocks(bag)
    first, rate = blocks[0].first_index, blocks[0].rate
    times: list[Array] = []
    values: list[Array] = []
    following = first
    for block in blocks:
        channels = list(block.channels)
        data = np.asarray(block.data, dtype=np.float64).reshape(-1, len(channels))
        column = data[:, channels.index(CHANNEL)]
        at = (block.first_index - first + np.arange(len(column))) / rate
        chosen = (at >= begin) & (at <= end)
        if chosen.any():
            if block.rate != rate or block.first_index < following:
                raise BagError(f"{bag.path}: {topic} starts anew at {at[0]:g} s; {_advice(at[0])}")
            if times and block.first_index > following:
                raise BagError(f"{bag.path}: scans are missing before {at[0]:g} s on {topic}; {_advice(at[0])}")
            invalid = at[chosen & ~np.isfinite(column)]
            if len(invalid):
                raise BagError(f"{bag.path}: {CHANNEL} is invalid at {invalid[0]:g} s; {_advice(invalid[0])}")
            times.append(at[chosen])
            values.append(column[chosen])
        following = block.first_index + len(column)
    if not times:
        last = (following - first) / rate
        raise BagError(f"{bag.path}: no scan from {begin:g} to {end:g} s; allowed: times from 0 to {last:g} s")
    return np.concatenate(times), np.concatenate(values)


def write_support(bag: Bag, folder: Path, begin: float = 0.0, end: float = math.inf) -> str:
    """Write the series as `folder`/support.csv and return a line about it. Raises BagError."""
    path = folder / FILE_NAME
    if path.exists():
        raise BagError(f"{path}: exists already and is not written over; give another folder with --out")
    times, values = support_series(bag, begin, end)
    lines = [",".join(COLUMNS), *(f"{t!r},{u!r}" for t, u in zip(times.tolist(), values.tolist(), strict=True))]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise BagError(f"{path}: cannot be written: {in_words(error)}") from None
    lasts = times[-1] - times[0]
    return f"{path}: {len(times)} samples over {lasts:g} s, from {values.min():g} to {values.max():g} m"


def _blocks(bag: Bag) -> tuple[str, list[Any]]:
    """Return the topic whose blocks hold the support's displacement, and those blocks."""
    topics = bag.topics_of("SampleBlock")
    for topic in topics:
        blocks = [message for _, message in bag.messages(topic) if len(message.data)]
        if blocks and CHANNEL in blocks[0].channels:
            return topic, blocks
    seen = ", ".join(topics) or "none"
    raise BagError(f"{bag.path}: no block has the channel {CHANNEL}; topics with samples: {seen}; record sensors/laser")


def _advice(at: float) -> str:
    return f"take a part without it, --support FROM:TO with TO below or FROM above {at:g}"
