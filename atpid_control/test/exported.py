# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag for the tests of exports: two rates, samples lost by index, an invalid one, an event, estimates."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from recorded import block, make

from atpid_control.cli import main
from atpid_control.runs.metadata import new_run
from atpid_control.runs.writer import BagWriter

ROOT = Path(__file__).resolve().parents[2]
BAG = ROOT / "bags/thesis_4_3_short"
RATE, SLOW = 1000.0, 320.0
START = 1_700_000_000_000_000_000
#: pandas reads floats to the last digit by default from version 3 on.
EXACT: dict[str, Any] = {} if int(pd.__version__.split(".")[0]) >= 3 else {"float_precision": "round_trip"}
LOST = (200, 60)  # first index, how many


def samples(index: Any, channels: int = 2) -> Any:
    """Return values (n, channels) whose last digits matter."""
    return np.sin(np.outer(index, np.arange(1, channels + 1)) * 0.1) / 3.0


def written(folder: Path, blocks: int = 10, size: int = 50, closed: bool = True, seed: int = 1) -> Path:
    """Write a bag of two rates: samples lost by index in the laser, an invalid one, an event, and estimates."""
    writer = BagWriter(folder, new_run(run_id="numbers", commit="none"))
    names = {"/sensors/laser": "SampleBlock", "/sensors/force": "SampleBlock", "/excitation": "Excitation",
             "/events": "Event"}  # fmt: skip
    for topic, kind in names.items():
        writer.add_topic(topic, f"atpid_interfaces/msg/{kind}")
    for number in range(blocks):
        first = number * size + (LOST[1] if number * size >= LOST[0] else 0)
        data = samples(first + np.arange(size))
        if number == 1:
            data[7, 1] = np.nan
        at = START + round(first / RATE * 1e9)
        writer.write("/sensors/laser", block(first, data, RATE, START, dropped=0), at, at)
        force = samples(number * 16 + np.arange(16), 1)
        told = {"channels": ["force"], "units": ["N"], "skew": np.array([1e-5])}
        writer.write("/sensors/force", block(number * 16, force, SLOW, START, **told), at + 1, at + 1)
        estimate = make("Excitation", at + 2, "identifier", quality=1, amplitude=0.01 / 3.0, frequency=5.5, used=number)
        writer.write("/excitation", estimate, at + 3_000_000, at + 2)
    event = make("Event", START + 5, "recorder_node", severity=1, kind="dropped", value=60.0, text='60 lost, "here" #1')
    writer.write("/events", event, START + 5, START + 5)
    if closed:
        writer.close({"finished": "yes"})
    return folder


def expected(channel: int) -> Any:
    """Return the laser's channel as it must come out: lost and invalid samples are NaN."""
    index = np.arange(10 * 50 + LOST[1])
    values = samples(index)[:, channel]
    values[LOST[0] : LOST[0] + LOST[1]] = np.nan
    if channel == 1:
        values[57] = np.nan
    return values


def run(bag: Path, form: str, out: Path, *more: str) -> str:
    """Export and return the path as text."""
    assert main(["bag", "export", str(bag), "--format", form, "--out", str(out), *more]) == 0
    return str(out)
