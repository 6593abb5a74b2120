# Copyright 2026 ATPID maintainers
# SPDX-License-Identifier: Apache-2.0
"""The latency of a run in real time: how long after the last sample of a block its estimate and its command are out."""

from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np

from atpid_common.latency import percentile
from atpid_control.runs.run import Run
from atpid_control.runs.tables import RECEIVED, STAMP
from atpid_control.runs.topics import BLOCK
from atpid_sim.plant.stream import last_stamp_ns

#: Stages of the loop, from the last sample of a block on.
STAGES = ("sample_to_block", "block_to_estimate", "estimate_to_command", "sample_to_command")

Latency = Mapping[str, Mapping[str, float]]


def latency_of(run: Run) -> Latency:
    """Return median, 99th percentile and maximum of each stage [s] of a run in real time; empty where there is none.

    A recorded time is that of the recorder, so a stage can come out a little too short or too long, even negative.
    """
    return {
        name: {"p50": percentile(values, 0.5), "p99": percentile(values, 0.99), "max": max(values)}
        for name, values in zip(STAGES, zip(*_answered(run), strict=True), strict=False)
    }


def summary_line(latency: Latency) -> str:
    """Return the line of the summary; empty where nothing was measured."""
    if not latency:
        return ""
    whole = latency["sample_to_command"]
    stages = ", ".join(f"{name.replace('_', ' ')} {1e3 * latency[name]['p99']:.1f}" for name in STAGES[:-1])
    figures = f"median {1e3 * whole['p50']:.1f}, 99 % {1e3 * whole['p99']:.1f}, largest {1e3 * whole['max']:.1f} ms"
    return f"sample to command: {figures} (99 % of {stages} ms)"


def _answered(run: Run) -> Iterator[tuple[float, float, float, float]]:
    """Yield the stages' durations [s] for each block of the laser that has an estimate and a command."""
    estimates, commands = (dict(received_of(run, kind)) for kind in ("Excitation", "CeilingCommand"))
    for _, end, block_ns in laser_blocks(run):
        if end in estimates and end in commands:
            times = (end, block_ns, estimates[end], commands[end])
            first, second, third = ((after - before) * 1e-9 for before, after in pairwise(times))
            yield first, second, third, (times[-1] - end) * 1e-9


def received_of(run: Run, kind: str) -> Iterator[tuple[int, int]]:
    """Yield (stamp, when it was recorded) [ns] of all messages of type atpid_interfaces/msg/`kind`."""
    fields = run.messages(kind)
    if fields:
        received = run.start_ns + np.rint(1e9 * fields[RECEIVED]).astype(np.int64)
        yield from zip(fields[STAMP].tolist(), received.tolist(), strict=True)


def laser_blocks(run: Run) -> list[tuple[int, int, int]]:
    """Return (stamps of its first and last sample, when it was recorded) [ns] of each block of the laser."""
    blocks = []
    for table, fields in run.tables.values():
        if table.rate is None and table.type == BLOCK and table.topic.endswith("laser"):
            names = (STAMP, "first_index", "scans", "rate")
            ends = [last_stamp_ns(*values) for values in zip(*(fields[name].tolist() for name in names), strict=True)]
            received = run.start_ns + np.rint(1e9 * fields[RECEIVED]).astype(np.int64)
            blocks += list(zip(fields[STAMP].tolist(), ends, received.tolist(), strict=True))
    return blocks
