# SPDX-License-Identifier: Apache-2.0
"""Reads a recording: a bag, or a table with one column a channel."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from atpid_common.errors import InputError
from atpid_control.bags.read import open_bag
from atpid_sim.system import Array


class CalibrationError(InputError):
    """A recording that does not determine the beam's parameters, or impossible masses."""


#: Sampling instants of a table may be off the even grid by this share of a step.
UNEVEN = 0.05
TOPIC = "/sensors/laser"


@dataclass(frozen=True)
class Recording:
    """Displacements (n,) [m], evenly sampled, NaN where invalid; `support` is None where it was not measured."""

    beam: Array
    support: Array | None
    rate: float  # [Hz]

    def between(self, begin: float, end: float) -> Recording:
        """Return the part from `begin` to `end`, seconds after the first sample. Raises CalibrationError."""
        length = self.beam.size / self.rate
        if not 0.0 <= begin < end:
            raise CalibrationError(f"--from {begin:g} --to {end:g}: allowed: within the recording, 0 to {length:g} s")
        first, last = math.ceil(begin * self.rate), self.beam.size if math.isinf(end) else math.floor(end * self.rate)
        if first >= self.beam.size:
            raise CalibrationError(f"--from {begin:g}: allowed: within the recording, 0 to {length:g} s")
        support = None if self.support is None else self.support[first:last]
        return Recording(self.beam[first:last], support, self.rate)


def read_recording(path: Path, support_channel: str, beam_channel: str) -> Recording:
    """Read a bag (its folder or .mcap file) or a .csv table with a header line and a column `time` [s].

    Raises CalibrationError where the file has no such beam channel or is not evenly sampled, BagError for a bad bag.
    """
    if not path.exists():
        raise CalibrationError(f"{path}: no such file; give a bag or a .csv table")
    if path.suffix.lower() == ".csv":
        return _from_table(path, support_channel, beam_channel)
    return _from_bag(path, support_channel, beam_channel)


def _from_table(path: Path, support_channel: str, beam_channel: str) -> Recording:
    with path.open(newline="", encoding="utf-8") as lines:
        rows = list(csv.reader(lines))
    header = [name.strip() for name in rows[0]] if rows else []
    for needed in ("time", beam_channel):
        if needed not in header:
            raise CalibrationError(f"{path}: columns {', '.join(header) or 'none'}; needed: {needed}")
    try:
        data = np.array([[float(cell) if cell.strip() else math.nan for cell in row] for row in rows[1:]])
        time = data[:, header.index("time")]
    except (ValueError, IndexError) as error:
        raise CalibrationError(f"{path}: not a table of numbers ({error})") from None
    rate = _even_rate(time, path)
    support = data[:, header.index(support_channel)] if support_channel in header else None
    return Recording(data[:, header.index(beam_channel)], support, rate)


def _even_rate(time: Array, path: Path) -> float:
    if time.size < 2 or not np.all(np.isfinite(time)):
        raise CalibrationError(f"{path}: needs at least two finite times")
    step = (time[-1] - time[0]) / (time.size - 1)
    if not (step > 0.0 and np.abs(time - time[0] - step * np.arange(time.size)).max() < UNEVEN * step):
        raise CalibrationError(f"{path}: not evenly sampled; fill what is missing with empty cells")
    return float(1.0 / step)


def _from_bag(path: Path, support_channel: str, beam_channel: str) -> Recording:
    blocks = list(open_bag(path).stream(TOPIC))
    channels = list(blocks[0].channels) if blocks else []
    if beam_channel not in channels:
        raise CalibrationError(f"{path}: {TOPIC} has channels {', '.join(channels) or 'none'}; needed: {beam_channel}")
    first, rate = int(blocks[0].first_index), float(blocks[0].rate)
    scans = [np.asarray(block.data, dtype=np.float64).reshape(-1, len(channels)) for block in blocks]
    data = np.full((int(blocks[-1].first_index) + len(scans[-1]) - first, len(channels)), np.nan)
    for block, values in zip(blocks, scans, strict=True):
        begin = int(block.first_index) - first
        data[begin : begin + len(values)] = values
    support = data[:, channels.index(support_channel)] if support_channel in channels else None
    return Recording(data[:, channels.index(beam_channel)], support, rate)
