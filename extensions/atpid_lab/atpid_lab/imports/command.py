# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""`atpid bag import FILE... --out BAG`: files of other programs as a bag of SampleBlocks in SI units.

It lists, and keeps, what it converted or left out.
"""

import argparse
import errno
import heapq
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from atpid_common.arguments import file_path, real, refuse, text
from atpid_common.errors import one_line
from atpid_common.files import Document, check
from atpid_common.message_checks import time_out_of_range
from atpid_control.runs.decode import message_type
from atpid_control.runs.errors import BagError
from atpid_control.runs.formats import Given, Grid, Reader, Series, formats
from atpid_control.runs.metadata import new_run
from atpid_control.runs.recover import building
from atpid_control.runs.topics import BLOCK
from atpid_control.runs.writer import BagWriter, check_new
from atpid_lab.imports.series import PIECE, si_of
from atpid_sim.display import working

_NOTES = "import.txt"
#: Messages a second, where they then have so many scans at least; and a number above which a value is none.
_BLOCKS, _SCANS, _LARGEST = 20.0, 32, 1e100
_CHUNK = 1 << 18  # [bytes]


class _Channel(NamedTuple):
    name: str
    unit: str
    factor: float
    series: Series
    source: str  # file and name there


def import_files(
    files: Sequence[Path], out: Path, wanted: Sequence[tuple[str, str]], rate: float | None = None, time: str = ""
) -> tuple[list[str], list[str]]:
    """Write the channels of files to the new bag `out`; return a line for each, and for what was changed or left out.

    wanted: names of channels, each with its column and what follows that (`Laser:mm`); empty: all columns, under their
    own names. rate [Hz]: rows of tables count as even. time: name of the column with times. Nothing is left where that
    fails. Raises BagError, FileError.
    """
    check_new(out)
    with building(out.absolute().parent, out.name, "the imported bag") as folder:
        given = Given(folder, rate, time)
        read = [(path, series) for path in files for series in _read(path, given)]
        channels = _unique(_chosen(read, wanted, given) if wanted else [_plain(*one, given) for one in read])
        if not channels:
            raise BagError(f"{', '.join(map(str, files))}: no channel to import{'; '.join(['', *given.notes])[:300]}")
        lines = _write(folder / out.name, files, _placed(channels, given), given)
        (folder / out.name).rename(out)
    return lines, given.notes


def readers() -> dict[str, Reader]:
    """Return what reads files, by their endings. Raises BagError: an installed format cannot be loaded."""
    found: dict[str, Reader] = {}
    for one in formats().values():
        if one.read is not None:
            found = dict.fromkeys(one.suffixes, one.read) | found
    return found


def _read(path: Path, given: Given) -> list[Series]:
    check(path, 2**40)
    known = readers()
    reader = known.get(path.suffix.lower())
    if reader is None:
        raise BagError(f"{path}: allowed: a file that ends in {', '.join(sorted(known))}")
    try:
        found = reader(path, given)
    except BagError:
        raise
    except ImportError as error:
        raise BagError(f"{path}: needs {error.name}, which is not installed; `make import` installs it") from None
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):  # of the columns that are kept in files
            raise
        raise BagError(f"{path}: cannot be read: {one_line(str(error))[:160]}; save it anew") from None
    except Exception as error:  # libraries raise many types of errors for damaged files
        reason = one_line(str(error))[:160] or type(error).__name__
        raise BagError(f"{path}: cannot be read as {path.suffix.lower()} ({reason}); save it anew") from None
    for series in found:
        grid = series.grid
        if reason := time_out_of_range(grid.rows + sum(index for _, index in grid.jumps[-1:]), grid.rate):
            raise BagError(f"{path}: {series.name}: {reason}; give --rate HZ")
    return found


def _plain(path: Path, series: Series, given: Given) -> _Channel:
    """Return a channel under its own name, in SI where its unit is known."""
    source = f"{path.name}: {series.name}"
    known = si_of(series.unit)
    if known is None:
        given.notes.append(f"{source}: its unit {series.unit!r} is not known and kept; --channels states another")
    elif not series.unit.strip():
        given.notes.append(f"{source}: no unit is stated; --channels states one")
    unit, factor = known or (series.unit.strip(), 1.0)
    name = re.sub(r"[^\w+.-]+", "_", series.name.rpartition("/")[2]).strip("_")
    return _Channel(name or "channel", unit, factor, series, source)


def _chosen(read: list[tuple[Path, Series]], wanted: Sequence[tuple[str, str]], given: Given) -> list[_Channel]:
    channels, used = [], set[int]()
    for name, column in wanted:
        path, series, stated = _found(read, name, column)
        unit, _, number = stated.partition(":")
        if stated and si_of(unit) is None:
            raise BagError(f"--channels {name}: given :{stated}; allowed: :unit[:factor], such as :mm or :m:0.002")
        try:
            factor = float(number or 1.0)
        except ValueError:
            factor = math.nan
        if not 0.0 < abs(factor) < math.inf:
            raise BagError(f"--channels {name}: given factor {number!r}; allowed: a number, not 0")
        plain = _plain(path, replace(series, unit=unit) if stated else series, given)
        channels.append(plain._replace(name=name, factor=factor * plain.factor))
        used.add(id(series))
    left = [f"{path.name}: {series.name}" for path, series in read if id(series) not in used]
    given.notes += [f"left out, not among --channels: {', '.join(left)}"] if left else []
    return channels


def _found(read: list[tuple[Path, Series]], name: str, column: str) -> tuple[Path, Series, str]:
    """Return file and series of a wanted channel, by the longest name that fits, and what follows it."""
    words = column.split(":")  # which a column's name may hold
    for count in range(len(words), 0, -1):
        one = ":".join(words[:count])
        fits = [(path, series) for path, series in read if f"/{path.name}/{series.name}".endswith(f"/{one}")]
        if len(fits) > 1:
            names = ", ".join(f"{path.name}/{series.name}" for path, series in fits)
            raise BagError(f"--channels {name}: given {one}, which several files or groups have: {names[:200]}")
        if fits:
            return *fits[0], ":".join(words[count:])
    names = ", ".join(series.name for _, series in read)
    raise BagError(f"--channels {name}: given {column}; in the files: {names[:300]}")


def _unique(channels: list[_Channel]) -> list[_Channel]:
    """Return the channels with names of their own: one that another has takes the file, group or number before it."""
    taken: dict[str, _Channel] = {}
    for one in channels:
        longer = re.sub(r"[^\w+.-]+", "_", one.source)
        names = chain((one.name, longer), (f"{longer}_{n}" for n in range(2, len(channels) + 2)))
        name = next(name for name in names if name not in taken)
        taken[name] = one._replace(name=name)
    return list(taken.values())


def _placed(channels: list[_Channel], given: Given) -> dict[Grid, list[_Channel]]:
    """Return the channels by what was sampled together, on one axis of stamps from 1970 or 0 on."""
    begun: dict[bool, int] = {}
    for grid in (one.series.grid for one in channels):
        begun[grid.dated] = min(grid.start_ns, begun.get(grid.dated, grid.start_ns))
    if len(begun) > 1:
        given.notes.append("some files have no date: taken as begun with the others")
    elif False in begun:
        times = f", times at {begun[False] * 1e-9:g} s" if begun[False] else ""
        given.notes.append(f"no date in it: stamps begin at 0{times}")
    streams: dict[Grid, list[_Channel]] = {}
    for one in channels:
        grid = one.series.grid
        if not grid.dated:
            grid = replace(grid, start_ns=grid.start_ns - min(0, begun[False]) + begun.get(True, 0), dated=True)
        streams.setdefault(grid, []).append(one)
    return streams


def _write(folder: Path, files: Sequence[Path], streams: dict[Grid, list[_Channel]], given: Given) -> list[str]:
    """Write the bag; return a line for each channel."""
    topics = {grid: f"/sensors/imported{f'_{n}' if n > 1 else ''}" for n, grid in enumerate(streams, 1)}
    lines = [
        f"{topics[grid]} {one.name} [{one.unit}] = {one.factor:.12g} × {one.source} [{one.series.unit}], "
        f"{grid.rows} samples at {grid.rate:.10g} Hz"
        for grid, group in streams.items()
        for one in group
    ]
    names = one_line(", ".join(path.name for path in files))  # the fact IMPORTED
    writer = BagWriter(folder, new_run(imported=names), chunk=_CHUNK)
    for topic in topics.values():
        writer.add_topic(topic, BLOCK)
    invalid = Counter[str]()
    messages = (_messages(topics[grid], grid, group, invalid) for grid, group in streams.items())
    for stamp, topic, data in heapq.merge(*messages, key=lambda one: one[0]):
        writer.write(topic, data, stamp, stamp)
    given.notes += [f"{name}: {count} samples are no finite number: NaN" for name, count in invalid.items() if count]
    writer.attach(_NOTES, "\n".join([*lines, *given.notes, ""]).encode())
    writer.close({"finished": "yes", "left_out_or_converted": str(len(given.notes))})
    return lines


def _messages(topic: str, grid: Grid, group: list[_Channel], invalid: Counter[str]) -> Iterator[tuple[int, str, bytes]]:
    """Yield (stamp, topic, message) of a stream; `invalid` counts the samples of each channel that are no numbers."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(message_type(BLOCK).definition, BLOCK))
    block, header, time = (store.types[name] for name in (BLOCK, "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
    fixed: Document = {
        "skew": np.zeros(len(group)),
        "rate": grid.rate,
        "backlog": 0,
        "handshake": False,
        "device": "import",
    }
    fixed |= {"channels": [one.name for one in group], "units": [one.unit for one in group]}
    scans = max(_SCANS, round(grid.rate / _BLOCKS))
    piece = scans * max(1, PIECE // scans)
    for (row, index), (until, _) in pairwise([(0, 0), *grid.jumps, (grid.rows, 0)]):
        for begin in range(row, until, piece):
            values = np.empty((min(piece, until - begin), len(group)))
            for place, one in enumerate(group):
                values[:, place] = np.asarray(one.series.values[begin : begin + len(values)], np.float64) * one.factor
                none = ~(np.abs(values[:, place]) <= _LARGEST)
                values[none, place] = np.nan
                invalid[one.name] += int(none.sum())
            for part in range(0, len(values), scans):
                first = index + begin - row + part
                stamp = grid.start_ns + round(first / grid.rate * 1e9)
                at = header(stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id="")
                data = values[part : part + scans].ravel()
                message = block(header=at, first_index=first, dropped=index - row, data=data, **fixed)
                yield stamp, topic, bytes(store.serialize_cdr(message, BLOCK))


EXAMPLE = "measured.csv --out out/measured --channels beam_displacement=Laser:mm support_displacement=Shaker:m:0.002"


def _wanted(given: str) -> tuple[str, str]:
    name, equals, column = given.partition("=")
    if not (name.isidentifier() and equals and column):
        refuse(given, "NAME=COLUMN[:unit[:factor]], such as beam_displacement=Laser:mm")
    return name, column


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    endings = f"of one bag; it ends in {', '.join(sorted(readers()))}"
    add("files", type=file_path, nargs="+", metavar="FILE", help=endings)
    add("--out", type=file_path, required=True, metavar="BAG", help="folder of the bag: a new one")
    channels = "take these, named so; a value is factor x column in the unit, which is converted to SI; default: all"
    add("--channels", type=_wanted, nargs="+", default=[], metavar="NAME=COLUMN[:unit[:factor]]", help=channels)
    rate = "the rate of tables without times, or whose times have too few digits: rows count as even"
    add("--rate", type=real(1e-3, 1e7, "Hz"), metavar="HZ", help=rate)
    add("--time", type=text, default="", metavar="COLUMN", help="the column of a table with times; default: time or t")


def run(given: argparse.Namespace) -> int:
    """Import and print what is in the bag, and what was converted or left out; return 0. Raises BagError, FileError."""
    with working("importing"):
        channels, notes = import_files(given.files, given.out, given.channels, given.rate, given.time)
    print(*channels, *(f"note: {line}" for line in notes), given.out, sep="\n")
    return 0
