# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests that every file format must pass.

Subclass `FormatContract` in a test file; pytest then runs them on the format that `make` returns:

    class TestVendor(FormatContract):
        def make(self) -> Format:
            return FORMAT
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from atpid_control.runs.decode import message_type
from atpid_control.runs.formats import Format, Given, Holds
from atpid_control.runs.metadata import new_run
from atpid_control.runs.source import Source
from atpid_control.runs.tables import INDEX, STAMP, TIME, Table
from atpid_control.runs.topics import BLOCK
from atpid_control.runs.writer import BagWriter
from atpid_sim.system import Array

_CHANNELS = ("support_displacement", "beam_displacement")
#: Of the bag that is written: its sampling rate [Hz], stamp of its first sample [ns], blocks, and scans of each.
_RATE, _START, _BLOCKS, _SCANS = 500.0, 1_700_000_000_000_000_000, 8, 50
#: Relative error of what comes back from a text of 12 digits.
_ROUNDED = 1e-9


def values() -> Array:
    """Return the samples of the bag (n, channels) [m]."""
    return np.asarray(np.sin(np.outer(np.arange(_BLOCKS * _SCANS), np.arange(1, len(_CHANNELS) + 1)) * 0.1) / 3.0)


def _bag_in(folder: Path) -> Path:
    """Write the bag, of one sensor with two channels; return its folder."""
    bag = folder / "bag"
    store: Any = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(message_type(BLOCK).definition, BLOCK))
    block, header, time = (store.types[name] for name in (BLOCK, "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
    layout = {"channels": list(_CHANNELS), "units": ["m"] * len(_CHANNELS), "skew": np.zeros(len(_CHANNELS))}
    fixed = {"rate": _RATE, "dropped": 0, "backlog": 0, "handshake": False, "device": "contract"}
    writer = BagWriter(bag, new_run(run_id="contract"))
    writer.add_topic("/sensors/laser", BLOCK)
    for number, data in enumerate(np.split(values(), _BLOCKS)):
        stamp = _START + round(number * _SCANS / _RATE * 1e9)
        at = header(stamp=time(sec=stamp // 10**9, nanosec=stamp % 10**9), frame_id="")
        message = block(header=at, first_index=number * _SCANS, data=data.ravel(), **layout, **fixed)
        writer.write("/sensors/laser", bytes(store.serialize_cdr(message, BLOCK)), stamp, stamp)
    writer.close({"finished": "yes"})
    return bag


class FormatContract:
    """What `Format` promises. Tests of what a format does not have, such as `write`, pass."""

    def make(self) -> Format:
        """Return the format."""
        raise NotImplementedError

    def example(self, folder: Path) -> Path:
        """Return a file of the format in `folder`, by default one it wrote; of a format that only reads, make one."""
        return self.file_of_samples(folder)

    def written(self, folder: Path) -> list[tuple[Table | None, Path]]:
        """Return what `write` makes of a bag, in a folder of its own."""
        write = self.make().write
        assert write is not None
        place = folder / "written"
        place.mkdir()
        source = Source(_bag_in(folder))
        return list(write(source, source.pieces(), place))

    def file_of_samples(self, folder: Path) -> Path:
        """Return the file in which the samples of the bag were written, with the format's usual ending."""
        made = self.written(folder)
        path = next(path for table, path in made if table is None or table.rate is not None)
        return path.rename(folder / f"run{self.make().suffixes[0]}")

    def test_it_has_a_name_endings_and_something_to_do(self) -> None:
        """The name is a word of the command line; endings are in lower case with the dot."""
        made = self.make()
        assert re.fullmatch(r"[a-z0-9][a-z0-9-]*", made.name)
        assert made.suffixes
        assert all(re.fullmatch(r"\.[a-z0-9]+", suffix) for suffix in made.suffixes)
        assert isinstance(made.holds, Holds)
        assert [one for one in (made.read, made.read_table, made.write) if one is not None]

    def test_files_are_written_into_the_folder_given_and_nothing_else(self, tmp_path: Path) -> None:
        """Each file has a table of the bag, or None where it holds several; samples are in one of them."""
        known = self.make()
        if known.write is None:
            return
        made = self.written(tmp_path)
        assert {item.name for item in tmp_path.iterdir()} == {"bag", "written"}
        assert all(path.parent == tmp_path / "written" and path.stat().st_size for _, path in made)
        assert len([table for table, _ in made if table is None or table.rate is not None]) == 1
        if known.holds is Holds.ONE:
            assert None not in [table for table, _ in made]
        else:
            assert len(made) == 1

    def test_a_bag_without_samples_is_refused_by_a_format_of_samples(self, tmp_path: Path) -> None:
        """Where a format holds samples alone, `write` raises an error of one line for pieces that have none."""
        known = self.make()
        if known.write is None or known.holds is not Holds.SAMPLES:
            return
        with pytest.raises(Exception, match=r".+") as caught:
            list(known.write(Source(_bag_in(tmp_path)), [], tmp_path))
        assert "\n" not in str(caught.value)

    def test_series_are_as_long_as_their_grid(self, tmp_path: Path) -> None:
        """`read` returns channels with names of their own, as many values as rows, and a rate."""
        read = self.make().read
        if read is None:
            return
        series = read(self.example(tmp_path), Given(tmp_path))
        assert series
        assert len({one.name for one in series}) == len(series)
        assert all(len(one.values) == one.grid.rows and one.grid.rate > 0.0 for one in series)

    def test_what_was_written_is_read_again(self, tmp_path: Path) -> None:
        """Samples to the digits of a text, the rate, and the stamp of the first sample where the file has a date."""
        read = self.make().read
        if read is None or self.make().write is None:
            return
        found = {one.name.rpartition("/")[2]: one for one in read(self.file_of_samples(tmp_path), Given(tmp_path))}
        for place, name in enumerate(_CHANNELS):
            one = found[name]
            np.testing.assert_allclose(one.values, values()[:, place], rtol=_ROUNDED, atol=_ROUNDED)
            assert one.grid.rate == pytest.approx(_RATE, rel=_ROUNDED)
            assert not one.grid.dated or abs(one.grid.start_ns - _START) <= 1000

    def test_a_table_is_evenly_sampled(self, tmp_path: Path) -> None:
        """`read_table` returns columns TIME, STAMP, INDEX and the channels, with an array of each."""
        read_table = self.make().read_table
        if read_table is None:
            return
        table, arrays, notes = read_table(self.example(tmp_path))
        assert table.type == self.make().name
        assert table.rate is not None
        assert [column.name for column in table.columns] == list(arrays)
        assert list(arrays)[:3] == [TIME, STAMP, INDEX]
        assert {len(array) for array in arrays.values()} == {table.rows}
        np.testing.assert_allclose(np.diff(arrays[TIME]) * table.rate, 1.0, atol=0.1)
        assert all("\n" not in line for line in notes)

    def test_a_file_of_another_kind_is_refused(self, tmp_path: Path) -> None:
        """Readers raise an error for bytes that mean nothing, and for none."""
        made = self.make()
        for number, content in enumerate((b"", bytes(range(256)) * 8)):
            path = tmp_path / f"{number}{made.suffixes[0]}"
            path.write_bytes(content)
            if made.read is not None:
                with pytest.raises(Exception, match=r".*"):
                    made.read(path, Given(tmp_path))
            if made.read_table is not None:
                with pytest.raises(Exception, match=r".*"):
                    made.read_table(path)
