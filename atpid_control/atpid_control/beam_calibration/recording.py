# SPDX-License-Identifier: Apache-2.0
"""Reads a recording: a bag, or a table with one column a channel."""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from atpid_common.errors import InputError
from atpid_common.files import FileError, check
from atpid_control.bags.read import Bag, open_bag
from atpid_sim.system import Array


class CalibrationError(InputError):
    """A recording that does not determine the beam's parameters, or impossible masses."""


#: Sampling instants of a table may be off the even grid by this share of a step.
UNEVEN = 0.05
#: Size of a table at most [bytes], and values of a recording, its gaps included: some 400 MB.
_LARGEST, _MOST_VALUES = 100_000_000, 50_000_000
TOPIC = "/sensors/laser"
#: Longest comment of a table [characters].
_LONGEST_LINE = 100_000


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
    if path.suffix.lower() == ".csv":
        return _from_table(path, support_channel, beam_channel)
    return recording_in(open_bag(path), support_channel, beam_channel)


def _from_table(path: Path, support_channel: str, beam_channel: str) -> Recording:
    try:
        check(path, _LARGEST)
        with path.open(newline="", encoding="utf-8-sig") as lines:
            before = _skip_comments(lines)
            columns = _columns(path, csv.reader(lines), ("time", beam_channel), support_channel, before)
    except FileError as error:
        raise CalibrationError(f"{error}; give a bag or a .csv table") from None
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error):
        raise CalibrationError(f"{path}: is no table in UTF-8; save it as CSV anew") from None
    rate = _even_rate(columns["time"], path)
    return Recording(columns[beam_channel], columns.get(support_channel), rate)


def _skip_comments(lines: TextIO) -> int:
    """Pass over the lines at the begin that are comments (`#`), as `export` writes them; return how many."""
    count, place = 0, lines.tell()
    while lines.readline(_LONGEST_LINE).startswith("#"):
        count, place = count + 1, lines.tell()
    lines.seek(place)
    return count


def _columns(
    path: Path, rows: Iterator[list[str]], needed: tuple[str, ...], wanted: str, before: int
) -> dict[str, Array]:
    """Return the columns `needed`, and the one `wanted` where there is one; an empty cell is NaN.

    A name may have its unit behind it, `time [s]`; `before`: lines before the header.
    """
    header = [name.partition(" [")[0].strip() for name in next(rows, [])]
    for name in needed:
        if name not in header:
            listed = ", ".join(header)[:200] or "none"
            raise CalibrationError(f"{path}: columns {listed!r}; needed: {name}")
    columns = {name: array("d") for name in (*needed, wanted) if name in header}
    places = [(header.index(name), column) for name, column in columns.items()]
    for number, row in enumerate(rows, 2 + before):
        if row and len(row) != len(header):
            raise CalibrationError(f"{path}, row {number}: {len(row)} cells; allowed: {len(header)}, as the header has")
        try:
            for place, column in places if row else ():
                column.append(float(row[place]) if row[place].strip() else math.nan)
        except ValueError:
            raise CalibrationError(
                f"{path}, row {number}: {row[place][:40]!r} is no number: not a table of numbers"
            ) from None
    return {name: np.array(column) for name, column in columns.items()}


def _even_rate(time: Array, path: Path) -> float:
    if time.size < 2 or not np.all(np.isfinite(time)):
        raise CalibrationError(f"{path}: needs at least two finite times")
    step = (time[-1] - time[0]) / (time.size - 1)
    if not (step > 0.0 and np.abs(time - time[0] - step * np.arange(time.size)).max() < UNEVEN * step):
        raise CalibrationError(f"{path}: not evenly sampled; fill what is missing with empty cells")
    return float(1.0 / step)


def recording_in(bag: Bag, support_channel: str, beam_channel: str) -> Recording:
    """Return the recording in an open bag. Raises as `read_recording`."""
    path, blocks = bag.path, list(bag.stream(TOPIC))
    channels = list(blocks[0].channels) if blocks else []
    if beam_channel not in channels:
        raise CalibrationError(f"{path}: {TOPIC} has channels {', '.join(channels) or 'none'}; needed: {beam_channel}")
    first, rate = int(blocks[0].first_index), float(blocks[0].rate)
    scans = [np.asarray(block.data, dtype=np.float64).reshape(-1, len(channels)) for block in blocks]
    length = int(blocks[-1].first_index) + len(scans[-1]) - first
    if length * len(channels) > _MOST_VALUES:
        lasts = f"{length} scans of {len(channels)} channels from the first to the last, gaps included"
        raise CalibrationError(f"{path}: {lasts}; allowed: {_MOST_VALUES} values; cut the bag")
    data = np.full((length, len(channels)), np.nan)
    for block, values in zip(blocks, scans, strict=True):
        begin = int(block.first_index) - first
        data[begin : begin + len(values)] = values
    support = data[:, channels.index(support_channel)] if support_channel in channels else None
    return Recording(data[:, channels.index(beam_channel)], support, rate)
