# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""Universal files: time responses of data sets 58, in ASCII or binary, read by pyuff record by record.

Records of one channel that follow each other, as this project's export writes them, are one channel, NaN between them.
"""

import re
from contextlib import suppress
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import pyuff

from atpid_common.files import Document
from atpid_control.runs.errors import BagError
from atpid_control.runs.formats import Given, Grid, Series
from atpid_lab.imports.series import shortest, si_of, timed

_TIME_RESPONSE, _TIME_AXIS, _EVEN = 1, 17, 1
#: Longest time between the records of a channel, all together [s], and that in samples over those there.
_MOST_MISSING, _MOST_TIMES = 600.0, 1000
#: Specific data types, with their SI units and by which factor of data set 164 they are divided.
_QUANTITIES = {8: ("m", "length"), 11: ("m/s", "length"), 12: ("m/s^2", "length"), 13: ("N", "force")}
_DIRECTIONS = {1: "+X", -1: "-X", 2: "+Y", -2: "-Y", 3: "+Z", -3: "-Z"}
#: What this project's export states beside the 6 digits of the format.
_EXACT = re.compile(r"rate (\S+) Hz, first stamp (\d+) ns")


def read(path: Path, given: Given) -> list[Series]:
    """Return the time responses. Raises BagError."""
    with path.open("rb") as stream:
        stream.seek(max(0, path.stat().st_size - 200))
        if not stream.read().rstrip().endswith(b"-1"):
            raise BagError(f"{path}: is cut off, its last data set has no end; save it anew")
    file = pyuff.UFF(str(path))
    kinds = [int(kind) for kind in file.get_set_types()]
    factors: Document = next((file.read_sets(place) for place, kind in enumerate(kinds) if kind == 164), {})
    others = sorted({kind for kind in kinds if kind not in (58, 151, 164)})
    if others:
        given.notes.append(f"{path.name}: data sets {', '.join(map(str, others))}: left out, no time responses")
    records: dict[tuple[str, float], list[Series]] = {}
    found: list[Series] = []
    for place in (place for place, kind in enumerate(kinds) if kind == 58):
        one = file.read_sets(place)
        name, values = _name(one), one["data"]
        if len(values) != one["num_pts"]:
            raise BagError(f"{path}: {name}: {len(values)} of {one['num_pts']} values; it is damaged, save it anew")
        if one["func_type"] not in (0, _TIME_RESPONSE) or one["abscissa_spec_data_type"] not in (0, _TIME_AXIS):
            given.notes.append(f"{path.name}: {name}: left out, no time response (function {one['func_type']})")
        elif np.iscomplexobj(values) or not len(values):
            given.notes.append(f"{path.name}: {name}: left out, {'complex' if len(values) else 'without'} values")
        elif one["abscissa_spacing"] != _EVEN:
            found += timed(path, "", {"time": ("s", one["x"]), name: (_unit(one, factors, given), values)}, given)
        else:
            rate, start_ns, dated = _times(one, given)
            made = Series(name, _unit(one, factors, given), values, Grid(rate, len(values), start_ns, dated))
            records.setdefault((name, rate), []).append(made)
    return found + [series for parts in records.values() for series in _joined(parts, given)]


def _name(one: Document) -> str:
    label, first = (str(one.get(key) or "").strip() for key in ("ordinate_axis_lab", "id1"))
    first = first.split(" of /")[0]
    place = f"{one['rsp_node']}{_DIRECTIONS.get(one['rsp_dir'], '')}"
    return next((text for text in (first, label) if text and text.upper() != "NONE"), f"node_{place}")


def _times(one: Document, given: Given) -> tuple[float, int, bool]:
    """Return rate [Hz], stamp of the first sample [ns], and whether it is since 1970."""
    exact = _EXACT.search(str(one.get("id5") or ""))
    if exact and not given.rate:
        return float(exact[1]), int(exact[2]), True
    step, after = float(one["abscissa_inc"]), round(float(one["abscissa_min"]) * 1e9)
    if not (step > 0.0 or given.rate):
        raise BagError(f"data set 58: its step is {step:g} s; give --rate HZ")
    rate = given.rate or shortest(1.0 / step, 5e-6)
    for form in ("%d-%b-%y %H:%M:%S", "%d-%b-%Y %H:%M:%S"):
        with suppress(ValueError):
            begin = datetime.strptime(str(one.get("id3") or "").strip(), form).replace(tzinfo=timezone.utc)
            return rate, int(begin.timestamp()) * 10**9 + after, True
    return rate, after, False


def _unit(one: Document, factors: Document, given: Given) -> str:
    """Return the unit of the ordinate: its label where that is known, else what its type has by data set 164."""
    label = str(one.get("ordinate_axis_units_lab") or "").strip()
    if label.upper() != "NONE" and label and si_of(label):
        return label
    quantity = _QUANTITIES.get(int(one["ordinate_spec_data_type"]))
    if quantity and float(factors.get(quantity[1], 1.0)) == 1.0:
        given.notes.append(f"{_name(one)}: unit taken from its data type: {quantity[0]}")
        return quantity[0]
    return "" if label.upper() == "NONE" else label


def _joined(parts: list[Series], given: Given) -> list[Series]:
    """Return the records of one name and rate as one series where they follow each other, NaN between, else as several.

    Each channel has its own gaps: as NaN they leave the channels of a table sampled together.
    """
    grid, name = parts[0].grid, parts[0].name
    begins = [round((one.grid.start_ns - grid.start_ns) * 1e-9 * grid.rate) for one in parts]
    ends = [begin + len(one.values) for begin, one in zip(begins, parts, strict=True)]
    missing = ends[-1] - sum(len(one.values) for one in parts)
    most = min(_MOST_MISSING * grid.rate, _MOST_TIMES * (ends[-1] - missing))
    if any(begin < end for end, begin in zip(ends, begins[1:], strict=False)) or missing > most:
        return [replace(one, name=f"{name}_{n}") if n else one for n, one in enumerate(parts)]
    if len(parts) == 1:
        return parts
    given.notes.append(f"{name}: {len(parts)} records are one channel, {missing} samples missing between them are NaN")
    values = np.full(ends[-1], np.nan)
    for begin, end, one in zip(begins, ends, parts, strict=True):
        values[begin:end] = one.values
    return [replace(parts[0], values=values, grid=replace(grid, rows=ends[-1]))]
